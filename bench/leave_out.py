#!/usr/bin/env python3
"""Counts the instructions of a step, and checks that parts left out by the plan cost none.

Runs each scene twice under callgrind and takes the difference: the engine's own functions only,
with functions inlined into them, since the C library selects functions by the processor. A part that
the plan leaves out (`left_out` of the runner's report) must not have cost one instruction in
the files and functions of LEFT_OUT.

    leave_out.py build/engine/constraint_sim_run                     a table
    leave_out.py build/engine/constraint_sim_run --check  COUNTS     fails when a count grew by over 3 %
    leave_out.py build/engine/constraint_sim_run --update COUNTS     stores these counts
    leave_out.py build/engine/constraint_sim_run --profile           instructions by file
    leave_out.py build/engine/constraint_sim_run --against dfc5a42   growth since that commit's counts
    leave_out.py build/engine/constraint_sim_run --around            the share outside of the substeps of runge_kutta

With --against, a file of COUNTS may replace the program: nothing is run.

The program needs its source lines (-g1). Counts depend on the compiler, which the file names;
with another one only left out parts are checked.
"""
import argparse
import collections
import concurrent.futures
import csv
import json
import math
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
MOST_GROWTH = 0.03
LEAST_SHARE = 0.05  # least share of a file in the profile
STEPS = 20
# a comparison or jump that the compiler placed beside a function may carry its line
TOLERATED = 2  # [instructions a step]
STEP = 'constraint_sim::engine::World::step()'
SUBSTEP = '*take_substep*'  # a substep of runge_kutta: stages, error estimate and projections

Scene = collections.namedtuple('Scene', 'name file first what options', defaults=((),))
AWAKE = ('--robot-fixed', '--sleep-after', '.inf')
SCENES = (
    Scene('pendulum', 'pendulum', 20, 'a point mass on a rod'),
    Scene('double_pendulum', 'double_pendulum', 20, 'two'),
    Scene('chain_heavy_end', 'chain_heavy_end', 20, 'eleven, the last one heavy'),
    Scene('chain_by_impulses', 'chain_heavy_end', 20, 'the same by sequential_impulses',
          ('--method', 'sequential_impulses')),
    Scene('heavy_load', 'heavy_load', 20, 'a million times heavier, stiff'),
    Scene('oscillator', 'oscillator', 20, 'spring and damper, driven'),
    Scene('platform', 'platform', 20, 'a closed loop of boxes with motors'),
    Scene('winch', 'winch', 20, 'a rope, a motor with a force limit, a contact'),
    Scene('bridge', 'bridge', 20, 'planks on ball joints, and a ball above'),
    Scene('balls_in_the_air', 'falling_balls', 20, '48 free spheres'),
    Scene('balls_that_meet', 'falling_balls', 300, 'the same with contacts'),
    Scene('boxes_that_touch', 'two_boxes', 800, 'two boxes, a floor, a rod'),
    Scene('boxes_at_rest', 'two_boxes', 1600, 'the same, asleep'),
    Scene('slider_crank', 'slider_crank', 20, 'a crank by a motor, a rod, a piston on its rail'),
    Scene('universal_shaft', 'universal_shaft', 20, 'two shafts, one by a motor'),
    Scene('peaucellier', 'peaucellier', 20, 'seven bars on ten hinges, one by a motor'),
    Scene('crane', 'crane', 20, 'a servo, stiff, and a winch'),
    Scene('safety_rope', 'safety_rope', 40, 'a rope that is slack'),
    Scene('breaking_rod', 'breaking_rod', 40, 'a rod that breaks'),
    Scene('rocking_block', 'rocking_block', 30, 'a box on a floor, from corner to corner'),
    Scene('newtons_cradle', 'newtons_cradle', 45, 'five balls on rods, and a blow'),
    Scene('ball_on_incline', 'ball_on_incline', 20, 'a ball that slides, then rolls'),
    Scene('weak_winch', 'weak_winch', 20, 'a motor at its force limit, and a contact'),
    Scene('chain_of_hinges', None, 20, 'ten bars, hinged by turns across each other'),
    Scene('arm', None, 20, 'seven bars on hinges with springs and dampers'),
    Scene('arm_with_friction', None, 20, 'the arm with friction and limits, without springs'),
    Scene('quadruped', None, 20, 'a trunk in flight with twelve hinges'),
    Scene('gear_train', 'gear_train', 20, 'a planetary gear with a motor'),
    Scene('screw', 'screw', 20, 'a nut on a screw'),
    Scene('four_bar', None, 20, 'three bars on four hinges, a loop that falls'),
    Scene('rod_off_centre', None, 20, 'a box on a rod beside its centre'),
    Scene('dome', None, 20, '258 rods, 63 too many, tumbling at 1/60 s'),
    Scene('robot_at_rest', 'arm.urdf', 20, 'six motors hold the shipped arm', AWAKE),
    Scene('robot_touches_itself', 'arm.urdf', 20, 'the same, where two of its links touch', AWAKE),
    Scene('robot_turns', 'arm.urdf', 20, 'the same arm turns, without collisions', AWAKE),
    Scene('robot_turns_touching', 'arm.urdf', 20, 'the same, where two of its links touch', AWAKE),
)
# Motors, and links that do not collide, are given beside a URDF file.
LINKS = ('base_link', 'shoulder', 'upper_arm', 'forearm', 'wrist_1_link', 'wrist_2_link', 'wrist_3_link')
MOTORS = {name: {'position': 0} for name in ('shoulder_pan', 'shoulder_lift', 'elbow', 'wrist_1', 'wrist_2', 'wrist_3')}
TURNING = {**MOTORS, 'shoulder_pan': {'amplitude': 0.5, 'frequency': 1}}
APART = {name: {'no_collision': True} for name in LINKS}
EXTRA = {'robot_at_rest': {'motors': MOTORS, 'links': APART}, 'robot_touches_itself': {'motors': MOTORS},
         'robot_turns': {'motors': TURNING, 'links': APART}, 'robot_turns_touching': {'motors': TURNING}}

# Parts that the plan may leave out, and their place: files, or functions of files.
LEFT_OUT = {
    'collision': ['collision/broadphase.', 'collision/narrowphase', 'collision/placed_shape.', 'collision/manifold_points.h',
                  'constraints/contact.cpp'],
    'boxes': ['collision/narrowphase_boxes.cpp', 'collision/narrowphase_box_box.cpp'],
    'friction': ['constraints/contact.cpp tangent_to'],
    'constraints': ['constraints/joint.', 'constraints/distance.', 'constraints/joint_kinds.', 'constraints/rows.',
                    'constraints/joint_vectors.', 'constraints/forms.', 'constraints/law.',
                    'constraints/anchor_pair.h', 'constraints/target.h', 'constraints/prescribed.'],
    'limits': ['constraints/target.h set_bias_limit'],
    'springs': ['constraints/target.h set_bias_soft', 'dynamics/force_elements.cpp add_spring_forces'],
    'motors': ['constraints/prescribed.h motor_motion', 'constraints/prescribed.h motor_phase',
               'constraints/prescribed.h motor_travel'],
    'rotation': ['model/mass_properties.h apply_inertia', 'model/mass_properties.h rotation',
                 'methods/runge_kutta/free_rotation.cpp FreeRotation', 'dynamics/kernels/chain_of_bodies.cpp',
                 'dynamics/kinematics.cpp place_arms',
                 'math/quaternion_state.h rotation_matrix',
                 'math/quaternion_state.h write_quaternion_rate', 'dynamics/kernels/tree_of_bodies.cpp',
                 'dynamics/kernels/tree_system.cpp', 'dynamics/kernels/tree_dynamics.cpp'],
    'wrenches': ['world/world.cpp find_acting_wrenches', 'methods/sequential_impulses/sequential_impulses.cpp apply_wrenches'],
    'runge_kutta': ['math/integrate.h', 'math/embedded_pairs.h', 'dynamics/kernels/chain_of_rods.',
                    'dynamics/kernels/chain_of_bodies.cpp', 'dynamics/kernels/tree_of_bodies.cpp',
                    'dynamics/kernels/tree_system.cpp', 'dynamics/kernels/tree_dynamics.cpp'],
    'energy_momentum': ['methods/energy_momentum/energy_momentum.cpp', 'dynamics/implicit/', 'math/saddle_lu.'],
    'event_driven': ['methods/event_driven/joints/event_', 'constraints/one_sided_law.', 'math/box_lcp.',
                     'dynamics/held_response.cpp'],
    'time_stepping': ['methods/time_stepping/converged_rows.', 'math/body_cone', 'math/proximal_newton.',
                      'math/frontal_', 'math/dense_front.h',
                      'methods/sequential_impulses/sequential_impulses.cpp', 'impulses/energy_account.cpp',
                      'impulses/free_turn.cpp', 'impulses/impulse_positions.cpp', 'impulses/row_solver.cpp',
                      'impulses/row_system.cpp'],
    'islands': [],
}
# Files shared by these parts: left out where all of them are.
SHARED = {place: {'runge_kutta', 'event_driven'}
          for place in ('math/integrate.h', 'math/embedded_pairs.h', 'dynamics/kernels/tree_system.cpp',
                        'dynamics/kernels/tree_dynamics.cpp')}


def lines_of(file, function):
    """Returns first and last line of each definition of the function, or of members of the class."""
    pattern = re.compile(r'^[\w:<>,&*\[\] ]*\b(?:%s::\w+|%s)\([^;]*$' % (function, function))
    spans, start = [], None
    for number, line in enumerate((ROOT / 'src/engine' / file).read_text().splitlines(), 1):
        if start is None and pattern.match(line):
            start = number
        if start is not None and (line == '}' or line.endswith('; }')):
            spans.append((start, number))
            start = None
    if not spans:
        raise SystemExit(f'leave_out: there is no {function} in {file}; LEFT_OUT has to follow')
    return spans


def matcher(place):
    """Returns a test whether a line of a file belongs to an entry of LEFT_OUT."""
    if ' ' not in place:
        if not list((ROOT / 'src/engine').glob(place + '*')):
            raise SystemExit(f'leave_out: there is no {place}; LEFT_OUT has to follow')
        return lambda file, line: file.startswith(place)
    name, function = place.split()
    spans = lines_of(name, function)
    return lambda file, line: file == name and any(a <= line <= b for a, b in spans)


def dome():
    """Returns the dome of redundant_scenes.h: an apex and rings of points, joined along rings, meridians and
    diagonals, with chords in the lowest ring."""
    rings, sides = 6, 11
    points = [(0.0, 0.0, 5.0)]
    for i in range(1, rings + 1):
        for k in range(sides):
            polar, angle = 0.24 * i, 2 * math.pi * (k + 0.5 * i) / sides
            points.append((5 * math.sin(polar) * math.cos(angle),
                           5 * math.sin(polar) * math.sin(angle), 5 * math.cos(polar)))

    def at(i, k):
        return 1 + (i - 1) * sides + k % sides

    rods = [(0, at(1, k)) for k in range(sides)]
    for i in range(1, rings + 1):
        for k in range(sides):
            rods.append((at(i, k), at(i, k + 1)))
            if i < rings:
                rods += [(at(i, k), at(i + 1, k + turn)) for turn in (0, 1, sides - 1)]
    rods += [(at(rings, k), at(rings, k + 2)) for k in range(sides)]
    rods += [(at(rings, k), at(rings, k + 3)) for k in range(5)]

    def velocity(x, y, z):  # (3, 1, 5) + (0.7, 1.1, 0.4) × x
        return [3 + 1.1 * z - 0.4 * y, 1 + 0.4 * x - 0.7 * z, 5 + 0.7 * y - 1.1 * x]

    return json.dumps({  # JSON is YAML too
        'world': {'method': 'auto', 'time_step': 1 / 60},
        'bodies': [{'name': f'p_{i}', 'mass': 1.0, 'position': x, 'linear_velocity': velocity(*x)}
                   for i, x in enumerate(points)],
        'constraints': [{'name': f'rod_{i}', 'type': 'distance', 'body_a': f'p_{a}',
                         'body_b': f'p_{b}'} for i, (a, b) in enumerate(rods)]}, indent=0)


def bars_on_hinges(bars, coordinate):
    """Returns bars in a row, each hinged to the previous one, alternately about y and z, with laws of the angle."""
    length = 0.4
    return json.dumps({
        'world': {'method': 'auto'},
        'bodies': [{'name': f'bar_{i}', 'mass': 1.0, 'shape': {'box': {'size': [length, 0.05, 0.05]}},
                    'position': [(i + 0.5) * length, 0, 0], 'no_collision': True}
                   for i in range(bars)],
        'constraints': [{'name': f'hinge_{i}', 'type': 'hinge',
                         'body_a': f'bar_{i - 1}' if i else 'world',
                         'anchor_a': [0.5 * length if i else 0, 0, 0],
                         'axis_a': [0, 0, 1] if i % 2 else [0, 1, 0],
                         'body_b': f'bar_{i}', 'anchor_b': [-0.5 * length, 0, 0],
                         'coordinates': [coordinate]}
                        for i in range(bars)]}, indent=0)


def chain_of_hinges():
    return bars_on_hinges(10, {})


def arm():
    return bars_on_hinges(7, {'stiffness': 50, 'damping': 2})


def arm_with_friction():
    return bars_on_hinges(7, {'damping': 0.1, 'friction': 0.05, 'lower': -2, 'upper': 2})


def quadruped():
    """Returns a trunk in flight with four legs of three hinges: about x, y and y."""
    bodies = [{'name': 'trunk', 'mass': 10.0, 'shape': {'box': {'size': [0.6, 0.3, 0.15]}},
               'angular_velocity': [0.3, 0.5, 0.2], 'no_collision': True}]
    joints = []
    for leg, (x, y) in enumerate(((0.3, 0.15), (0.3, -0.15), (-0.3, 0.15), (-0.3, -0.15))):
        links = ((0.1, [1, 0, 0]), (0.3, [0, 1, 0]), (0.3, [0, 1, 0]))
        top, before, anchor = 0.0, 'trunk', [x, y, 0]
        for k, (length, axis) in enumerate(links):
            name = f'leg_{leg}_{k}'
            bodies.append({'name': name, 'mass': 0.5, 'shape': {'box': {'size': [0.05, 0.05, length]}},
                           'position': [x, y, top - length / 2], 'no_collision': True})
            joints.append({'name': f'hinge_{leg}_{k}', 'type': 'hinge', 'body_a': before, 'anchor_a': anchor,
                           'axis_a': axis, 'body_b': name, 'anchor_b': [0, 0, length / 2],
                           'coordinates': [{'stiffness': 20, 'damping': 0.5}]})
            top, before, anchor = top - length, name, [0, 0, -length / 2]
    return json.dumps({'world': {'method': 'auto'}, 'bodies': bodies, 'constraints': joints}, indent=0)


def four_bar():
    """Returns a crank, a coupler and a rocker on four hinges about y, which is a loop with three redundant rows."""
    points = ((0, 0, 0), (0, 0, 0.3), (0.9, 0, 0.6), (1, 0, 0))
    middles = [[(a + b) / 2 for a, b in zip(points[i], points[i + 1])] for i in range(3)]

    def anchor(end, point):  # identity orientations
        return list(point) if end < 0 or end > 2 else [p - m for p, m in zip(point, middles[end])]

    def name(end):
        return 'world' if end < 0 or end > 2 else f'bar_{end}'

    return json.dumps({
        'world': {'method': 'auto'},
        'bodies': [{'name': name(i), 'mass': 1.0, 'shape': {'box': {'size': [0.3, 0.05, 0.05]}},
                    'position': middles[i], 'no_collision': True} for i in range(3)],
        'constraints': [{'name': f'hinge_{i}', 'type': 'hinge', 'axis_a': [0, 1, 0],
                         'body_a': name(i - 1), 'anchor_a': anchor(i - 1, points[i]),
                         'body_b': name(i), 'anchor_b': anchor(i, points[i])} for i in range(4)]}, indent=0)


def rod_off_centre():
    """Returns a box on one rod, which holds it beside its centre."""
    return json.dumps({
        'world': {'method': 'auto'},
        'bodies': [{'name': 'box', 'mass': 1.0, 'shape': {'box': {'size': [0.4, 0.3, 0.2]}},
                    'position': [1.0, 0, 0], 'no_collision': True}],
        'constraints': [{'name': 'rod', 'type': 'distance', 'body_a': 'world', 'body_b': 'box',
                         'anchor_b': [-0.2, 0.1, 0.05]}]}, indent=0)


GENERATED = {f.__name__: f for f in (dome, chain_of_hinges, arm, arm_with_friction, quadruped, four_bar,
                                       rod_off_centre)}


def tick_of(scene):
    found = re.search(r'^\s*"?time_step"?: *([\d.e-]+)', scene.read_text(), re.M)
    return float(found.group(1)) if found else 0.01


def profile(program, scene, steps, folder, without=()):
    """Returns the instructions of these steps by (file, line), without those of functions with the patterns
    `without`, and the parts left out by the plan afterwards."""
    path, options = ROOT / 'config/scenes' / f'{scene.file}.yaml', scene.options
    if scene.file is None:
        path = folder / f'{scene.name}.yaml'
        path.write_text(GENERATED[scene.name]())
    elif scene.name in EXTRA:
        path, extra = ROOT / 'config/robots' / scene.file, folder / f'{scene.name}.yaml'
        extra.write_text(json.dumps(EXTRA[scene.name]))
        options = (*options, '--robot-extra', extra)
    out, report = folder / f'{scene.name}_{steps}.out', folder / f'{scene.name}_{steps}.json'
    subprocess.run(
        ['valgrind', '--tool=callgrind', f'--callgrind-out-file={out}', '--compress-strings=no',
         '--compress-pos=no', *(f'--toggle-collect={function}' for function in (STEP, *without)), program,
         path, '--duration', str(steps * tick_of(path)), '--report', report, *options],
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return parse(out, os.path.basename(program)), json.loads(report.read_text())['left_out']


def parse(path, program):
    """Parses a callgrind file. Costs follow the file they belong to, which may be inlined there; the cost of a
    call follows its `calls` line and is the callee's. Inlined library code counts for the function's file, line 0."""
    instructions = collections.Counter()
    is_own = is_call = False
    file = of_function = ''
    for line in path.open():
        key, _, value = line.rstrip('\n').partition('=')
        if key == 'ob':
            is_own = os.path.basename(value) == program
        elif key in ('fl', 'fi', 'fe'):
            file = own_name(value)
            if key == 'fl':
                of_function = file
        elif key == 'calls':
            is_call = True
        elif line[:1].isdigit():
            if is_own and not is_call:
                number, cost = map(int, line.split()[:2])
                instructions[(file, number) if file else (of_function, 0)] += cost
            is_call = False
    return instructions


def own_name(path):
    """Returns the path below src/engine or include/constraint_sim/engine; '' for libraries."""
    found = re.search(r'/(?:src/engine|include/constraint_sim/engine)/(.*)', path)
    return found.group(1) if found else ''


def count(program, scene, folder):
    until_first, _ = profile(program, scene, scene.first, folder)
    until_last, left_out = profile(program, scene, scene.first + STEPS, folder)
    until_last.subtract(until_first)
    if not any(file for file, _ in until_last):
        raise SystemExit(f'leave_out: {program} has no source lines (-g1), without which nothing can be checked')
    broken = []
    names = {line.split(':')[0] for line in left_out}
    for what in sorted(names):
        if what not in LEFT_OUT:
            raise SystemExit(f'leave_out: the plan leaves out "{what}", which LEFT_OUT does not know')
        for place in LEFT_OUT[what]:
            if not SHARED.get(place, names) <= names:
                continue
            is_there = matcher(place)
            cost = sum(n for (file, number), n in until_last.items() if is_there(file, number))
            if cost > TOLERATED * STEPS:
                broken.append(f'{scene.name}: {what} is left out, but {place} took {cost / STEPS:g} '
                              'instructions a step')
    by_file = collections.Counter()
    for (file, _), cost in until_last.items():
        by_file[file or 'libraries'] += cost
    return {'scene': scene.name,
            'instructions': round(sum(until_last.values()) / STEPS),
            'by_file': by_file,
            'left_out': ' '.join(line.split(':')[0] for line in left_out)}, broken


def count_around(program, scene, folder):
    """Returns the instructions of a step of the scene, and of these the ones outside of substeps; None where
    substeps of runge_kutta are not all of the mathematics."""
    counts = []
    for without in ((), (SUBSTEP,)):
        until_first, _ = profile(program, scene, scene.first, folder, without)
        until_last, left_out = profile(program, scene, scene.first + STEPS, folder, without)
        counts.append(round((sum(until_last.values()) - sum(until_first.values())) / STEPS))
        names = {line.split(':')[0] for line in left_out}
        if 'runge_kutta' in names or not {'energy_momentum', 'event_driven', 'time_stepping'} <= names:
            return None
    return counts


def print_around(program, folder, pool):
    print('| scene | instructions a step | outside of substeps | share |\n| --- | ---: | ---: | ---: |')
    for scene, counts in zip(SCENES, pool.map(lambda scene: count_around(program, scene, folder), SCENES)):
        if counts:
            print(f'| {scene.name} | {counts[0]} | {counts[1]} | {counts[1] / counts[0]:.0%} |')


def compiler():
    return subprocess.run(['c++', '--version'], text=True, stdout=subprocess.PIPE,
                          check=True).stdout.splitlines()[0]


def counts_in(text):
    """Returns the compiler and the instructions of each scene."""
    lines = text.splitlines()
    return lines[0][2:], {row['scene']: int(row['instructions'])
                          for row in csv.DictReader(lines[1:])}


def compare(path, rows):
    of, expected = counts_in(path.read_text())
    if of != compiler():
        print(f'{path} is of another compiler ({of}): counts are not compared')
        return []
    grown = [f'{row["scene"]}: {row["instructions"]} instructions a step, were {expected[row["scene"]]}'
             for row in rows if row['instructions'] > expected[row['scene']] * (1 + MOST_GROWTH)]
    if grown:
        grown.append('if that is on purpose, take them over with --update')
    return grown


def older_counts(where):
    """Returns the text of a file, or of the file in a commit."""
    if os.path.exists(where):
        return counts_in(pathlib.Path(where).read_text())
    return counts_in(subprocess.run(
        ['git', '-C', ROOT, 'show', f'{where}:bench/instructions.csv'], text=True,
        stdout=subprocess.PIPE, check=True).stdout)


def print_growth(where, rows, of):
    older, before = older_counts(where)
    if older != of:
        print(f'{where} is of another compiler ({older})')
    print(f'| scene | instructions a step | in {where} | growth |\n| --- | ---: | ---: | ---: |')
    for row in rows:
        was = before.get(row['scene'])
        growth = f'{row["instructions"] / was - 1:+.2%}' if was else ''
        print(f'| {row["scene"]} | {row["instructions"]} | {was or ""} | {growth} |')


def print_profile(rows):
    print('| scene | instructions a step | spent in |\n| --- | ---: | --- |')
    for row in rows:
        total = sum(row['by_file'].values())
        shares = [f'{file} {cost / total:.0%}' for file, cost in row['by_file'].most_common()
                  if cost > LEAST_SHARE * total]
        print(f'| {row["scene"]} | {row["instructions"]} | {", ".join(shares)} |')


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('program', help='constraint_sim_run, or with --against counts')
    parser.add_argument('--check', metavar='COUNTS', type=pathlib.Path)
    parser.add_argument('--update', metavar='COUNTS', type=pathlib.Path)
    parser.add_argument('--profile', action='store_true')
    parser.add_argument('--around', action='store_true')
    parser.add_argument('--against', metavar='COUNTS or COMMIT')
    options = parser.parse_args()

    if options.against and options.program.endswith('.csv'):
        of, counts = counts_in(pathlib.Path(options.program).read_text())
        print_growth(options.against, [{'scene': scene, 'instructions': n}
                                       for scene, n in counts.items()], of)
        return

    with tempfile.TemporaryDirectory() as folder, \
            concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        if options.around:
            print_around(options.program, pathlib.Path(folder), pool)
            return
        counted = list(pool.map(
            lambda scene: count(options.program, scene, pathlib.Path(folder)), SCENES))
    rows = [row for row, _ in counted]
    complaints = [complaint for _, broken in counted for complaint in broken]

    if options.profile:
        print_profile(rows)
    elif options.against:
        print_growth(options.against, rows, compiler())
    else:
        print('| scene | what it is | instructions a step | left out |\n'
              '| --- | --- | ---: | --- |')
        for scene, row in zip(SCENES, rows):
            print(f'| {scene.name} | {scene.what} | {row["instructions"]} | '
                  f'{row["left_out"]} |')
    if options.check:
        complaints += compare(options.check, rows)
    if options.update:
        with open(options.update, 'w', newline='') as file:
            file.write(f'# {compiler()}\n')
            writer = csv.DictWriter(file, ('scene', 'instructions'), extrasaction='ignore',
                                    lineterminator='\n')
            writer.writeheader()
            writer.writerows(rows)
    for complaint in complaints:
        print(f'leave_out: {complaint}', file=sys.stderr)
    sys.exit(1 if complaints else 0)


if __name__ == '__main__':
    main()
