"""Values of a study file, each checked as it is read; what cannot be names its key."""
import math

import numpy as np
import yaml

from . import expressions


class StudyError(ValueError):
    """What cannot be, with the key of the study file."""


class StrictLoader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):
    """Refuses a key that is there twice."""

    def construct_mapping(self, node, deep=False):
        keys = [key.value for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise StudyError(f'{key}: is there twice')
        return super().construct_mapping(node, deep)


def expect_keys(where, value, known):
    if not isinstance(value, dict):
        raise StudyError(f'{where}: must be a map, got {value!r}')
    for key in value:
        if key not in known:
            raise StudyError(f'{where}: unknown key {key!r}; there are ' + ', '.join(known))
    return value


def number(where, value, above=-math.inf):
    """A number or an expression of numbers."""
    try:
        result = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) \
            else float(expressions.value(value))
    except (expressions.ExpressionError, TypeError, ValueError, OverflowError) as error:
        raise StudyError(f'{where}: must be a number, got {value!r} ({error})') from None
    if not math.isfinite(result) or not result > above:
        raise StudyError(f'{where}: must be a finite number' +
                         (f' > {above:g}' if above > -math.inf else '') + f', got {value!r}')
    return result


def whole(where, value, least):
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise StudyError(f'{where}: must be a whole number >= {least}, got {value!r}')
    return value


def listed(where, value):
    found = value if isinstance(value, list) else [value]
    if not found:
        raise StudyError(f'{where}: is empty')
    return found


def scene_value(where, value):
    """Of a `values` list: numbers and expressions, words, flags, or lists of numbers."""
    if isinstance(value, list):
        return tuple(number(where, element) for element in value)
    if isinstance(value, (bool, int)):
        return value
    if isinstance(value, float) or (isinstance(value, str) and value[:1] in '0123456789-+.'):
        return number(where, value)
    if isinstance(value, str) and value.replace('_', '').isalnum():
        return value
    raise StudyError(f'{where}: must be a number, a word, or a list of numbers, got {value!r}')


def spread(where, kind, value, scale):
    """Values from a to b, both included."""
    if not isinstance(value, list) or len(value) != 3:
        raise StudyError(f'{where}: {kind} must be [from, to, count], got {value!r}')
    least = 0.0 if kind == 'logarithmic' else -math.inf
    a, b = number(where, value[0], least), number(where, value[1], least)
    count = whole(f'{where}: count', value[2], 1)
    found = np.linspace(scale(a), scale(b), count)
    if kind == 'logarithmic':
        found = np.exp(found)
    found[0], found[-1] = (a, b) if count > 1 else (a, a)
    return [float(f'{element:.12g}') for element in found]  # 10, not 10.000000000000011
