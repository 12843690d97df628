"""Pictures of the page, as SVG of a few kB each: scenes, ratios, error against run time, stability, sizes."""
import collections
import html
import math

import numpy as np
import yaml

import package_path  # noqa: F401
from constraint_sim.sweep import figures

from kinds import KINDS

# ---- a picture, and a chart with logarithmic axes

ENGINES = {'constraint_sim': '#c8102e', 'mujoco': '#2e8b3d', 'bullet': '#2f6fd0', 'ode': '#7d3fb5',
           'simbody': '#e07b00', 'dart': '#666666'}
NAMES = {'mujoco': 'MuJoCo', 'bullet': 'Bullet', 'ode': 'ODE', 'simbody': 'Simbody', 'dart': 'DART'}
TARGETS = {1e-2: '#9ecae1', 1e-4: '#4292c6', 1e-6: '#08306b'}  # errors of the picture of ratios
GREY, LIGHT = '#555555', '#dddddd'


def digits(value):
    """Returns a coordinate to a tenth of a pixel."""
    text = f'{value:.1f}'
    return text[:-2] if text.endswith('.0') else text


def path_of(points):
    return 'M' + 'L'.join(f'{digits(x)} {digits(y)}' for x, y in points)


class Picture:
    """Elements of an SVG on white; y points down."""

    def __init__(self, width, height):
        self.size = width, height
        self.rules = []
        self.elements = [f'<rect width="{width}" height="{height}" fill="#fff"/>']

    def add(self, name, text=None, **attributes):
        inside = ' '.join(f'{key.replace("_", "-")}="{digits(value) if isinstance(value, float) else value}"'
                          for key, value in attributes.items())
        self.elements.append(f'<{name} {inside}' + ('/>' if text is None else f'>{html.escape(text)}</{name}>'))

    def text(self, x, y, text, size=11, anchor='start', fill='#000', **style):
        """Writes a text; attributes that all texts of a picture share are the defaults of an SVG."""
        given = {'font_size': (size, 11), 'text_anchor': (anchor, 'start'), 'fill': (fill, '#000')}
        style.update({key: value for key, (value, default) in given.items() if value != default})
        self.add('text', text, x=float(x), y=float(y), **style)

    def line(self, points, colour, width=1.0, closed=False, fill='none', **style):
        self.add('path', d=path_of(points) + ('Z' if closed else ''), stroke=colour, stroke_width=float(width), fill=fill,
                 **style)

    def dots(self, points, colour, size):
        """Draws all points as one path of segments without length and with round ends."""
        if points:
            self.add('path', d=''.join(path_of([point]) + 'h0' for point in points), stroke=colour,
                     stroke_width=float(size), stroke_linecap='round')

    def segments(self, ends, colour):
        """Draws lines of one colour, each from the first to the second of two points, as one path."""
        if ends:
            self.add('path', d=''.join(map(path_of, ends)), stroke=colour)

    def boxes(self, boxes, colour):
        """Fills rectangles (x, y, width, height) by one path."""
        if boxes:
            self.add('path', fill=colour, d=''.join(
                f'{path_of([(x, y)])}h{digits(width)}v{digits(height)}h{digits(-width)}Z'
                for x, y, width, height in boxes))

    def save(self, path):
        width, height = self.size
        style = [f'<style>{"".join(self.rules)}</style>'] if self.rules else []
        path.write_text('\n'.join([
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
            'font-family="DejaVu Sans,Verdana,sans-serif" font-size="11">', *style, *self.elements, '</svg>\n']))


def power(exponent):
    """Returns a power of ten as text."""
    return f'{10.0 ** exponent:g}' if -1 <= exponent <= 3 else f'1e{exponent}'


class LogAxis:
    """A logarithmic scale from `low` to `high` on the pixels from `start` to `end`."""

    def __init__(self, low, high, start, end):
        self.low, self.high = math.floor(math.log10(low)), math.ceil(math.log10(high))
        self.high = max(self.high, self.low + 1)
        self.start, self.end = start, end

    def at(self, value):
        share = (math.log10(value) - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self, most):
        """Returns the exponents to be written, at most so many."""
        step = next(step for step in (1, 2, 3, 4, 5, 10) if (self.high - self.low) / step <= most)
        return [k for k in range(self.low, self.high + 1) if k % step == 0]


def frame(picture, x, y, x_label, y_label, most=(6, 6)):
    """Draws grid lines and labels of two axes."""
    columns, rows = ([axis.at(10.0 ** k) for k in axis.ticks(count)] for axis, count in zip((x, y), most))
    picture.segments([((at, y.start), (at, y.end)) for at in columns] +
                     [((x.start, at), (x.end, at)) for at in rows], LIGHT)
    for k, at in zip(x.ticks(most[0]), columns):
        picture.text(at, y.start + 14, power(k), size=10, anchor='middle', fill=GREY)
    for k, at in zip(y.ticks(most[1]), rows):
        picture.text(x.start - 5, at + 3.5, power(k), size=10, anchor='end', fill=GREY)
    picture.text((x.start + x.end) / 2, y.start + 30, x_label, size=10, anchor='middle', fill=GREY)
    at = f'{digits(x.start - 40)} {digits((y.start + y.end) / 2)}'
    picture.add('text', y_label, transform=f'translate({at}) rotate(-90)', font_size=10, text_anchor='middle',
                fill=GREY)


def legend(picture, names, x, y, gap=118):
    """Draws a line and a name for each engine, from left to right."""
    for i, name in enumerate(names):
        at = x + gap * i
        picture.line([(at, y - 4), (at + 18, y - 4)], ENGINES[name], 3.0 if name == figures.OURS else 1.5)
        picture.text(at + 23, y, NAMES.get(name, name), size=11)


def engine_of(contestant):
    return contestant.split()[0]


# ---- ratios of run times

def ratios(lines, kinds, path):
    """Draws for each problem the run time of the best other engine over ours, by kind, in two columns.

    `lines` are those of figures.comparison, `kinds` gives the kind of each problem.
    """
    shown = [line for line in lines if line[1] in TARGETS]
    rows = {kind.name: sorted({line[0] for line in shown if kinds[line[0]] == kind.name and (line[2] or line[3])})
            for kind in KINDS}
    blocks = [(kind.title, rows[kind.name]) for kind in KINDS if rows[kind.name]]
    # the first column takes kinds until it has half of all rows
    heights = [len(names) + 1.6 for _, names in blocks]
    split = min(range(len(blocks) + 1), key=lambda i: max(sum(heights[:i]), sum(heights[i:])))
    row, top, width = 13.0, 66.0, 960
    height = int(top + row * max(sum(heights[:split]), sum(heights[split:])) + 40)
    known = [line[4] for line in shown if not math.isnan(line[4])] or [1.0]
    low, high = min(*known, 0.1), max(*known, 1000.0)
    picture = Picture(width, height)
    picture.text(10, 20, 'Run time of the best other engine / run time of constraint_sim', size=14)
    picture.text(10, 38, 'left of 1: the other engine is faster; triangle: only constraint_sim (right) or only another '
                         'engine (left) reaches the error within the time limit', fill=GREY)
    for i, (target, colour) in enumerate(TARGETS.items()):
        picture.add('circle', cx=650.0 + 105 * i, cy=16.0, r=4.0, fill=colour)
        picture.text(660 + 105 * i, 20, f'error 1e{round(math.log10(target))}')
    columns = [column for column in (blocks[:split], blocks[split:]) if column]
    for column, content in enumerate(columns):
        left = 480.0 * column
        axis = LogAxis(low, high, left + 155, left + 440)
        bottom = top + row * sum(len(names) + 1.6 for _, names in content)
        picture.add('rect', x=axis.start, y=top - 8, width=axis.at(1.0) - axis.start, height=bottom - top + 8,
                    fill='#fdeaea')
        for k in range(axis.low, axis.high + 1):
            at = axis.at(10.0 ** k)
            picture.segments([((at, top - 8), (at, bottom))], '#000' if k == 0 else '#2e8b3d' if k == 1 else LIGHT)
            picture.text(at, bottom + 13, power(k), size=10, anchor='middle', fill=GREY)
        y, marks = top, {'bars': [], 'dots': {colour: [] for colour in TARGETS.values()},
                         'alone': {colour: [] for colour in TARGETS.values()}}
        for title, names in content:
            picture.text(left + 10, y + 9, title, size=12, font_weight='bold')
            y += 1.3 * row
            for name in names:
                picture.text(left + 150, y + 3.5, name, size=9.5, anchor='end')
                mark_ratios(marks, [line for line in shown if line[0] == name], axis, y)
                y += row
            y += 0.3 * row
        picture.segments(marks['bars'], '#bbb')
        for colour, points in marks['dots'].items():
            picture.dots(points, colour, 7.0)
        for colour, triangles in marks['alone'].items():
            if triangles:
                picture.add('path', d='Z'.join(map(path_of, triangles)) + 'Z', fill=colour)
    picture.save(path)


def mark_ratios(marks, lines, axis, y):
    """Adds the marks of a problem: a bar from the least to the largest ratio, dots, and triangles."""
    found = [(axis.at(line[4]), TARGETS[line[1]]) for line in lines if not math.isnan(line[4])]
    if len(found) > 1:
        marks['bars'].append(((min(found)[0], y), (max(found)[0], y)))
    for x, colour in found:
        marks['dots'][colour].append((x, y))
    alone = [TARGETS[line[1]] for line in lines if line[2] and not line[3]]
    for i, colour in enumerate(alone):
        x = axis.end + 5 + 9 * i
        marks['alone'][colour].append([(x, y - 3.5), (x, y + 3.5), (x + 6, y)])
    behind = [TARGETS[line[1]] for line in lines if line[3] and not line[2]]
    for i, colour in enumerate(behind):
        x = axis.start + 4 + 9 * i
        marks['alone'][colour].append([(x + 6, y - 3.5), (x + 6, y + 3.5), (x, y)])


# ---- error against run time

SMALLEST = 1e-16  # where an error of zero is drawn


def fronts(runs, names, path):
    """Draws a panel for each problem: of each engine the runs that none of its own beats in error and run time."""
    names = [name for name in names if runs.get(name)]
    if not names:
        return False
    picture = Picture(320 * len(names) + 20, 300)
    engines = {engine_of(contestant) for name in names for contestant in runs[name]}
    for i, name in enumerate(names):
        lines = collections.defaultdict(list)
        for contestant, found in runs[name].items():
            for run in found:
                lines[engine_of(contestant)].append((run.time, max(figures.judged(run.errors), SMALLEST)))
        points = [point for line in lines.values() for point in line]
        x = LogAxis(min(time for time, _ in points), max(time for time, _ in points), 320.0 * i + 65, 320.0 * i + 320)
        y = LogAxis(min(error for _, error in points), min(max(error for _, error in points), 10.0), 245.0, 45.0)
        picture.text((x.start + x.end) / 2, 36, name, size=12, anchor='middle', font_weight='bold')
        frame(picture, x, y, 'run time of a simulated second [µs]', 'error [m or rad]')
        for engine in ENGINES:
            front = [point for point in figures.pareto(lines[engine]) if point[1] <= 10.0 ** y.high]
            if not front:
                continue
            places = [(x.at(time), y.at(error)) for time, error in front]
            is_ours = engine == figures.OURS
            picture.line(places, ENGINES[engine], 2.5 if is_ours else 1.2)
            picture.dots(places, ENGINES[engine], 6.0 if is_ours else 4.0)
    legend(picture, [name for name in ENGINES if name in engines], 20, 294, gap=min(118, 320 * len(names) / 6))
    picture.save(path)
    return True


# ---- stability

def stability(counts, path):
    """Draws for each contestant the share of each class of the stability grid."""
    order = sorted(counts, key=lambda name: (not figures.is_ours(name), engine_of(name), name))
    shown = [kind for kind in figures.CLASSES if any(counts[name][kind] for name in order)]
    row, left, width = 16.0, 210.0, 700.0
    picture = Picture(920, int(50 + row * len(order) + 10))
    for i, kind in enumerate(shown):
        x = 10.0 + 98 * i
        picture.add('rect', x=x, y=10.0, width=12.0, height=12.0, fill=figures.CLASSES[kind])
        picture.text(x + 17, 20, kind if kind != 'n/a' else 'not possible', size=11)
    y, boxes = 36.0, {kind: [] for kind in shown}
    for name in order:
        total, x = sum(counts[name].values()), left
        picture.text(left - 6, y + 11, name.replace('_', ' '), size=10, anchor='end')
        for kind in shown:
            share = width * counts[name][kind] / total
            if share > 0.0:
                boxes[kind].append((x, y, share, row - 3))
            x += share
        y += row
    for kind, own in boxes.items():
        picture.boxes(own, figures.CLASSES[kind])
    picture.save(path)


# ---- growing numbers of bodies

def sizes(rows, path):
    """Draws the run time of a step of 1 ms against the number of links, bodies and contacts; of each engine its
    fastest contestant."""
    lines = figures.growth(rows, 'time')
    kinds = sorted({kind for kind, _ in lines})
    if not kinds:
        return False
    picture = Picture(320 * len(kinds) + 20, 300)
    values = [value for line in lines.values() for _, value in line]
    counts = [count for line in lines.values() for count, _ in line]
    for i, kind in enumerate(kinds):
        x = LogAxis(min(counts), max(counts), 320.0 * i + 65, 320.0 * i + 320)
        y = LogAxis(min(values), max(values), 245.0, 45.0)
        picture.text((x.start + x.end) / 2, 36, kind, size=12, anchor='middle', font_weight='bold')
        frame(picture, x, y, f'number of {kind}', 'run time of a step of 1 ms [µs]')
        for engine, colour in ENGINES.items():
            best = {}
            for (own_kind, contestant), line in lines.items():
                if own_kind == kind and engine_of(contestant) == engine:
                    for count, value in line:
                        best[count] = min(value, best.get(count, math.inf))
            if best:
                picture.line([(x.at(count), y.at(best[count])) for count in sorted(best)], colour,
                             2.5 if engine == figures.OURS else 1.2)
    engines = {engine_of(contestant) for _, contestant in lines}
    legend(picture, [name for name in ENGINES if name in engines], 20, 294)
    picture.save(path)
    return True


# ---- scenes

NEAR = 1e3  # joints are drawn over all bodies [m]
# rows: right, up and towards the viewer, in the world's x, y and z
VIEW = np.array([[math.cos(0.35), math.sin(0.35), 0.0],
                 [-math.sin(0.35) * math.sin(0.3), math.cos(0.35) * math.sin(0.3), math.cos(0.3)],
                 [math.sin(0.35) * math.cos(0.3), -math.cos(0.35) * math.cos(0.3), math.sin(0.3)]])


def turned(quaternion, vectors):
    """Rotates vectors (rows) by a quaternion x, y, z, w."""
    axis, w = np.asarray(quaternion[:3], float), float(quaternion[3])
    cross = np.cross(axis, vectors)
    return vectors + 2.0 * (w * cross + np.cross(axis, cross))


def half_size(body):
    """Returns the half edges of a body's box; of a body without a shape those of a solid box of its inertia."""
    box = body['shape'].get('box')
    if box:
        return np.asarray(box['size'], float) / 2.0
    inertia, mass = np.asarray(body['inertia'], float), float(body['mass'])
    squares = (inertia.sum() - 2.0 * inertia) * 1.5 / mass
    return np.sqrt(np.maximum(squares, 0.0))


def faces(body):
    """Returns the visible faces of a body's box, as corners in view coordinates."""
    half = half_size(body)
    found = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = side * half[axis]
            corners[:, u] = half[u] * np.array([-1.0, 1.0, 1.0, -1.0])
            corners[:, v] = half[v] * np.array([-1.0, -1.0, 1.0, 1.0])
            normal = np.zeros((1, 3))
            normal[0, axis] = side
            if (turned(body['orientation'], normal) @ VIEW.T)[0, 2] > 1e-9:
                found.append((turned(body['orientation'], corners) + body['position']) @ VIEW.T)
    return found


def anchor(scene_bodies, constraint, side):
    """Returns an anchor of a constraint in view coordinates, or None."""
    name, local = constraint.get(f'body_{side}'), constraint.get(f'anchor_{side}')
    if local is None:
        return None
    local = np.asarray(local, float)
    if name in scene_bodies:
        body = scene_bodies[name]
        local = turned(body['orientation'], local[None])[0] + body['position']
    return VIEW @ local


def shapes_of(scene):
    """Returns [(depth, kind, points, radius)] of a scene, in view coordinates; planes are left out."""
    bodies = {body['name']: body for body in scene['bodies']}
    found = []
    for body in bodies.values():
        shape = body['shape']
        centre = VIEW @ np.asarray(body['position'], float)
        if 'plane' in shape:
            continue
        if 'sphere' in shape:
            found.append((centre[2], 'ball', [centre], float(shape['sphere']['radius'])))
        elif half_size(body).min() > 0.0:
            found.extend((points[:, 2].mean(), 'face', points, 0.0) for points in faces(body))
        else:
            found.append((centre[2], 'point', [centre], 0.0))
    for constraint in scene['constraints']:
        ends = [end for end in (anchor(bodies, constraint, 'a'), anchor(bodies, constraint, 'b')) if end is not None]
        if not ends:
            continue
        depth = max(end[2] for end in ends) + 1e-6
        if constraint['type'] == 'distance':
            found.append((depth, 'rod', ends, 0.0))
        else:
            found.append((depth + NEAR, 'joint', ends[:1], 0.0))
    return sorted(found, key=lambda shape: shape[0])


def ground_of(scene):
    """Returns the height of a horizontal plane, or None; a tilted plane is drawn as horizontal in its own frame."""
    for body in scene['bodies']:
        if 'plane' in body['shape']:
            return float(body['position'][2])
    return None


def scenes(texts, path):
    """Draws scenes in rows by kind. `texts` gives (title of the kind, name of the problem, scene as YAML)."""
    width, height, columns = 236, 190, 4
    rows = math.ceil(len(texts) / columns)
    picture = Picture(width * columns, height * rows)
    picture.rules = ['.rod{stroke:#8a5a2b;stroke-width:1.3}', '.joint,.point{stroke-width:5.6;stroke-linecap:round}',
                     '.joint{stroke:#c8102e}', '.point{stroke:#35506e}',
                     '.ball{fill:#9db8d9;stroke:#35506e;stroke-width:.7}',
                     '.face{fill:#c4d4e8;stroke:#35506e;stroke-width:.8}']
    for number, (kind, name, text) in enumerate(texts):
        left, top = width * (number % columns), height * (number // columns)
        picture.text(left + 10, top + 18, name, size=12, font_weight='bold')
        picture.text(left + 10, top + 33, kind, size=10, fill=GREY)
        draw_scene(picture, yaml.safe_load(text), left + 12, top + 42, width - 24, height - 54)
    picture.save(path)


def draw_scene(picture, scene, left, top, width, height):
    shapes = shapes_of(scene)
    points = np.array([np.asarray(point[:2]) + radius * np.array(sign) for _, _, own, radius in shapes
                       for point in own for sign in ((-1, -1), (1, 1))])
    ground = ground_of(scene)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    scale = 0.9 * min(width / extent[0], height / extent[1])
    middle = (low + high) / 2.0

    def at(point):
        return (left + width / 2 + scale * (point[0] - middle[0]), top + height / 2 - scale * (point[1] - middle[1]))

    if ground is not None:
        y = at(low)[1]
        picture.add('rect', x=float(left), y=y - 8, width=float(width), height=14.0, fill='#e6e0d4')
    dots = {'point': [], 'joint': []}
    rods = [path_of([at(point) for point in own]) for _, kind, own, _ in shapes if kind == 'rod']
    if rods:
        picture.add('path', **{'class': 'rod'}, d=''.join(rods))
    for i, (_, kind, own, radius) in enumerate(shapes):
        if kind == 'face':
            picture.add('path', **{'class': 'face'}, d=path_of([at(point) for point in own]) + 'Z')
        elif kind == 'ball' and not is_hidden(own[0], radius, shapes[i + 1:]):
            x, y = at(own[0])
            picture.add('circle', **{'class': 'ball'}, cx=x, cy=y, r=max(scale * radius, 1.0))
        elif kind in dots:
            dots[kind].append(path_of([at(own[0])]) + 'h0')
    for kind, places in dots.items():
        if places:
            picture.add('path', **{'class': kind}, d=''.join(places))


def is_hidden(centre, radius, nearer):
    """Returns whether nearer balls cover a ball: its centre and points close to its rim."""
    angles = np.arange(8) * math.pi / 4.0
    rim = centre[:2] + 0.9 * radius * np.vstack(([0.0, 0.0], np.column_stack((np.cos(angles), np.sin(angles)))))
    covered = np.zeros(len(rim), bool)
    for _, kind, own, other in nearer:
        if kind == 'ball':
            covered |= np.linalg.norm(rim - own[0][:2], axis=1) < other
    return covered.all()
