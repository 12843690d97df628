"""Values of a study file, each checked as it is read; what cannot be names its key."""
import math
import os
import reprlib
import stat

import numpy as np
import yaml

from . import expressions

MOST_BYTES = 6 << 20  # size of a file, as for scenes
MOST_DEPTH = 32  # lists and maps within each other, as for scenes
MOST_VALUES = 1_000_000  # values of one parameter
MOST_ELEMENTS = 200_000  # elements of a study file


class StudyError(ValueError):
    """An invalid value; the text names its key in the study file."""


def shown(value):
    """A value as a message quotes it: short, however much it holds and however deep."""
    quoting = reprlib.Repr()
    quoting.maxlevel, quoting.maxstring, quoting.maxother = 3, 80, 80
    return quoting.repr(value)


def read_text(path, most=MOST_BYTES):
    """The text of a regular file of at most so many bytes; nothing is waited for. Throws OSError and
    ValueError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError('it is no regular file')
        with open(descriptor, 'rb', closefd=False) as file:
            found = file.read(most + 1)
    finally:
        os.close(descriptor)
    if len(found) > most:
        raise OSError(f'it has more than {most} bytes')
    return found.decode()


class StrictLoader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):
    """Refuses a key that is there twice."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise StudyError('a key is a list or a map')
            if key.value in seen:
                raise StudyError(f'{key.value[:80]}: is there twice')
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def check_size(document):
    """Aliases may make a document of any size out of a short text."""
    left, count = [document], 0
    while left:
        value = left.pop()
        count += 1
        if count > MOST_ELEMENTS:
            raise StudyError(f'has more than {MOST_ELEMENTS} values, those of aliases counted each time')
        left += value if isinstance(value, list) else value.values() if isinstance(value, dict) else ()


def load_yaml(text):
    """Returns the value of a YAML text. Throws StudyError; the depth is counted first, for yaml recurses."""
    loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
    depth = 0
    try:
        for event in yaml.parse(text, Loader=loader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MOST_DEPTH:
                raise StudyError(f'lists and maps more than {MOST_DEPTH} deep')
        document = yaml.load(text, Loader=StrictLoader)
        check_size(document)
        return document
    except StudyError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise StudyError(f'not valid YAML: {error}') from None


def expect_keys(where, value, known):
    if not isinstance(value, dict):
        raise StudyError(f'{where}: must be a map, got {shown(value)}')
    for key in value:
        if key not in known:
            raise StudyError(f'{where}: unknown key {shown(key)}; there are ' + ', '.join(known))
    return value


def number(where, value, above=-math.inf):
    """A number or an expression of numbers."""
    if not isinstance(value, (str, int, float)):
        raise StudyError(f'{where}: must be a number, got {shown(value)}')
    try:
        result = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) \
            else float(expressions.value(value))
    except (expressions.ExpressionError, TypeError, ValueError, OverflowError) as error:
        raise StudyError(f'{where}: must be a number, got {shown(value)} ({error})') from None
    if not math.isfinite(result) or not result > above:
        raise StudyError(f'{where}: must be a finite number' +
                         (f' > {above:g}' if above > -math.inf else '') + f', got {shown(value)}')
    return result


def whole(where, value, least, most=math.inf):
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        bound = f'<= {most}' if isinstance(value, int) and value > most else f'>= {least}'
        raise StudyError(f'{where}: must be a whole number {bound}, got {shown(value)}')
    return value


def listed(where, value):
    found = value if isinstance(value, list) else [value]
    if not found:
        raise StudyError(f'{where}: is empty')
    return found


def scene_value(where, value):
    """Returns an element of a `values` list: a number or expression, a word, a flag, or a list of numbers."""
    if isinstance(value, list):
        return tuple(number(where, element) for element in value)
    if isinstance(value, (bool, int)):
        return value
    if isinstance(value, float) or (isinstance(value, str) and value[:1] in '0123456789-+.'):
        return number(where, value)
    if isinstance(value, str) and value.replace('_', '').isalnum():
        return value
    raise StudyError(f'{where}: must be a number, a word, or a list of numbers, got {shown(value)}')


def spread(where, kind, value, scale):
    """Values from a to b, both included."""
    if not isinstance(value, list) or len(value) != 3:
        raise StudyError(f'{where}: {kind} must be [from, to, count], got {shown(value)}')
    least = 0.0 if kind == 'logarithmic' else -math.inf
    a, b = number(where, value[0], least), number(where, value[1], least)
    count = whole(f'{where}: count', value[2], 1, MOST_VALUES)
    if not math.isfinite(b - a):
        raise StudyError(f'{where}: {kind} spans more than numbers can, got {shown(value)}')
    found = np.linspace(scale(a), scale(b), count)
    if kind == 'logarithmic':
        found = np.exp(found)
    found[0], found[-1] = (a, b) if count > 1 else (a, a)
    return [float(f'{element:.12g}') for element in found]  # 10, not 10.000000000000011
