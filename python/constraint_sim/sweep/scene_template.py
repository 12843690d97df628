"""A scene as text with places to fill in. The rest of the text stays as it was written, so a case is what a
person would have typed, and the runner reads the same."""
import math

import yaml

LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class PathError(ValueError):
    pass


def written(value):
    """A value as YAML 1.2 has it, numbers with the digits that give the same double again."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, float):
        if math.isinf(value):
            return '.inf' if value > 0 else '-.inf'
        return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(written(element) for element in value) + ']'
    return str(value)


class SceneTemplate:
    """Text of a scene, and where in it values go. Paths: `bodies.NAME.key`, `constraints.NAME.key`,
    `world.key`, `bodies.NAME.position.0`; a list is entered by name or number, `*` is all of it."""

    def __init__(self, text, source='scene'):
        self.source = source
        self.text, self.root = text, self._compose(text)
        if not isinstance(self.root, yaml.MappingNode):
            raise PathError(f'{source}: is no scene')
        if 'world' not in (key.value for key, _ in self.root.value):
            start = self.root.start_mark.index
            place = start + 1 if self.root.flow_style else start
            world = 'world: {}, ' if self.root.flow_style else \
                'world: {}\n' + ' ' * self.root.start_mark.column
            self.text = text[:place] + world + text[place:]
            self.root = self._compose(self.text)
        counts = {}
        self._count(self.root, counts)
        self.shared = {identity for identity, count in counts.items() if count > 1}

    def _compose(self, text):
        try:
            return yaml.compose(text, Loader=LOADER)
        except yaml.YAMLError as error:
            raise PathError(f'{self.source}: not valid YAML: {error}') from None

    def _count(self, node, counts):
        counts[id(node)] = counts.get(id(node), 0) + 1
        if counts[id(node)] > 1 or isinstance(node, yaml.ScalarNode):
            return
        for child in node.value:
            for part in child if isinstance(child, tuple) else (child,):
                self._count(part, counts)

    def places(self, path):
        """Where a path leads: [(start, end, before, after)] in the text, a value between before and
        after replacing what is there. Throws PathError."""
        words = str(path).split('.')
        if len(words) < 2 or '' in words:
            raise PathError(f'{path}: a path is like bodies.NAME.mass or world.time_step')
        found = self._places(self.root, words, 0, path)
        if not found:
            raise PathError(f'{path}: the list is empty')
        return found

    def _places(self, node, words, at, path):
        if id(node) in self.shared:
            raise PathError(f'{path}: {".".join(words[:at])} is a YAML alias, used in several places')
        so_far = '.'.join(words[:at]) or 'the scene'
        if at == len(words):
            if not isinstance(node, yaml.ScalarNode) and not node.flow_style:
                raise PathError(f'{path}: is written over several lines; write it as [...] or {{...}}')
            return [(node.start_mark.index, node.end_mark.index, '', '')]
        if isinstance(node, yaml.MappingNode):
            for key, child in node.value:
                if key.value == words[at]:
                    return self._places(child, words, at + 1, path)
            if at + 1 < len(words) or at == 0:
                raise PathError(f'{path}: there is no {words[at]!r} in {so_far}; there are '
                                + ', '.join(key.value for key, _ in node.value))
            start = node.start_mark.index
            if node.flow_style:
                return [(start + 1, start + 1, f'{words[at]}: ', ', ' if node.value else '')]
            return [(start, start, f'{words[at]}: ', '\n' + ' ' * node.start_mark.column)]
        if isinstance(node, yaml.SequenceNode):
            return self._in_list(node, words, at, path, so_far)
        raise PathError(f'{path}: {so_far} is a value and has no {words[at]!r}')

    def _in_list(self, node, words, at, path, so_far):
        if words[at] == '*':
            return [place for child in node.value
                    for place in self._places(child, words, at + 1, path)]
        named = {value.value: child for child in node.value if isinstance(child, yaml.MappingNode)
                 for key, value in child.value if key.value == 'name'}
        for end in range(len(words), at, -1):  # names may have dots
            name = '.'.join(words[at:end])
            if name in named:
                return self._places(named[name], words, end, path)
        if words[at].isdigit() and int(words[at]) < len(node.value):
            return self._places(node.value[int(words[at])], words, at + 1, path)
        raise PathError(f'{path}: there is no {words[at]!r} in {so_far}; there are '
                        + (', '.join(named) or f'0 to {len(node.value) - 1}'))

    def multiplied(self, path, places, factor):
        """For `filled`: each place with its number, or list of numbers, times the factor."""
        found = []
        for place in places:
            text = self.text[place[0]:place[1]]
            try:
                numbers = [float(number) for number in text.strip('[]').split(',')]
            except ValueError:
                raise PathError(f'{path}: factors multiply numbers that the scene has, got {text!r}') from None
            scaled = tuple(factor * number for number in numbers)
            found.append(([place], scaled if text.startswith('[') else scaled[0]))
        return found

    def filled(self, values):
        """The text with these values, [(places of a path, value)]."""
        parts, position = [], 0
        edits = sorted(((start, order, end, before + written(value) + after)
                        for order, (places, value) in enumerate(values)
                        for start, end, before, after in places))
        for start, _, end, new in edits:
            # several keys new to an empty {} are parted by commas
            if parts and start == position and parts[-1] and start > 0 and \
                    self.text[start - 1] == '{' and not new.endswith(', ') and start == end:
                parts.append(', ')
            parts += [self.text[position:start], new]
            position = end
        return ''.join(parts) + self.text[position:]
