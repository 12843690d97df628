"""Studies: rejected ones, cases that are run, equality with the runner's results, and no lost cases."""
import csv
import io
import json
import math
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from constraint_sim import engine
from constraint_sim.sweep import (case_process, command, executors, expressions, figures, pages, peers,
                                  progress, report, scene_template, store, study, tables)
from constraint_sim.sweep.program import identity
from support import ENVIRONMENT, RUNNER, SCENES, SOURCES

TIMING = set(store.TIMING)
COMMAND = [sys.executable, str(SOURCES / 'src/tools/constraint_sim_sweep')]
SCENE = """# a pendulum
world: {gravity: [0, 0, -9.81], time_step: 0.01}
bodies:
  - {name: bob, mass: 1, position: [1, 0, 0]}   # a comment stays
constraints:
  - name: rod.a
    type: distance
    body_b: bob
"""
STUDY = """
scene: scene.yaml
duration: 0.5
parameters:
  mass: {path: bodies.bob.mass, values: [1, 2.5, 7]}
  start: {path: bodies.bob.position.0, linear: [1, 2, 3]}
methods: [auto, {name: si, method: sequential_impulses, iterations: 20}]
time_steps: [1/100, 1/50]
"""


def make(folder, text=STUDY, scene=SCENE):
    folder.mkdir(exist_ok=True)
    (folder / 'scene.yaml').write_text(scene)
    (folder / 'study.yaml').write_text(text)
    return folder / 'study.yaml'


def sweep(path, *options, status=0):
    assert command.main([str(path), '--no-plots', *options]) == status
    return read(path.with_suffix('.results') / 'results.csv')


def read(path):
    with open(path, newline='') as file:
        return list(csv.DictReader(file))


def untimed(rows):
    return [{name: value for name, value in row.items() if name not in TIMING} for row in rows]


def runner_hash(text, duration, folder):
    scene, report = folder / 'one.yaml', folder / 'one.json'
    scene.write_text(text)
    subprocess.run([RUNNER, scene, '--duration', str(duration), '--report', report], check=True,
                   stdout=subprocess.DEVNULL)
    return json.loads(report.read_text())['state_hash']


# ---- scenes with places to fill in

def filled(text, **values):
    template = scene_template.SceneTemplate(text)
    return template.filled([(template.places(path.replace('__', '.')), value)
                            for path, value in values.items()])


def test_filling_changes_nothing_else():
    assert filled(SCENE, bodies__bob__mass=2.5) == SCENE.replace('mass: 1,', 'mass: 2.5,')
    assert filled(SCENE, bodies__bob__position__0=0.1) == SCENE.replace('[1, 0, 0]', '[0.1, 0, 0]')
    assert filled(SCENE, bodies__0__position=(1.0, 2.5, 3.0)) == SCENE.replace('[1, 0, 0]', '[1, 2.5, 3]')
    template = scene_template.SceneTemplate(SCENE)
    new = template.filled([(template.places('constraints.rod.a.length'), 2.0),
                           (template.places('world.tolerance'), 1e-9),
                           (template.places('world.order'), 5),
                           (template.places('bodies.*.mass'), 3.0)])
    world = engine.load_scene(new)
    assert world.joint('rod.a')['length'] == 2.0 and world.body('bob')['mass'] == 3.0
    assert (world.options['tolerance'], world.options['order']) == (1e-9, 5)
    for scene in sorted(SCENES.glob('*.yaml')):
        template = scene_template.SceneTemplate(scene.read_text())
        new = template.filled([(template.places('world.tolerance'), 1e-5),
                               (template.places('world.iterations'), 33)])
        options = engine.load_scene(new).options
        assert (options['tolerance'], options['iterations']) == (1e-5, 33), scene.name


def test_filling_a_scene_without_a_world():
    for text in ('bodies: []\n', '# comment\nbodies: []\n', '---\nbodies: []\n', '{bodies: []}\n',
                 'world: {}\nbodies: []\n'):
        template = scene_template.SceneTemplate(text)
        options = engine.load_scene(template.filled([(template.places('world.time_step'), 0.25),
                                                     (template.places('world.order'), 5)])).options
        assert (options['time_step'], options['order']) == (0.25, 5), text


def test_numbers_keep_their_bits():
    numbers = random.Random(1)
    for _ in range(300):  # within the bounds of a mass
        value = numbers.uniform(1.0, 10.0) * 10.0 ** numbers.randint(-20, 19)
        assert engine.load_scene(filled(SCENE, bodies__bob__mass=value)).body('bob')['mass'] == value
    assert engine.load_scene(filled(SCENE, world__sleep_after=math.inf)).options['sleep_after'] == math.inf


@pytest.mark.filterwarnings('error')
def test_expressions():
    assert expressions.value('1/60') == 1.0 / 60.0
    assert expressions.value('2 * cos(pi) ** 2 - -1') == 3.0
    assert expressions.value('a * sin(0) + t', {'a': 2.0, 't': 3.0}) == 3.0
    for text in ('__import__("os")', 'a.b', '[1]', 'x if y else z', 'lambda: 1', '1 +', '"text"', 'f(1)',
                 'sin(1, 2, 3, 4)', 'True'):
        with pytest.raises(expressions.ExpressionError):
            expressions.value(text)


# ---- what is refused, before anything runs

REFUSED = (
    ('bodies.bob.mass', 'bodies.bob.weight', "unknown key 'weight'"),
    ('bodies.bob.mass', 'bodies.rob.mass', "there is no 'rob' in bodies; there are bob"),
    ('bodies.bob.mass', 'mass', 'a path is like'),
    ('bodies.bob.mass', 'bodies.bob.mass.x', "is a value and has no 'x'"),
    ('[1, 2.5, 7]', '[]', 'parameters.mass.values: is empty'),
    ('[1, 2.5, 7]', '[1, -2.5]', 'must be a finite number > 0, got -2.5'),
    ('[1, 2.5, 7]', '[1, 1]', 'has a value twice'),
    ('[1, 2, 3]', '[1, 2, 0]', 'must be a whole number >= 1, got 0'),
    ('linear: [1, 2, 3]', 'logarithmic: [0, 2, 3]', 'must be a finite number > 0, got 0'),
    ('values: [1, 2.5, 7]', 'factors: [1, heavy]', "parameters.mass.factors: must be a number, got 'heavy'"),
    ('values: [1, 2.5, 7]', 'factors: [2, 2]', 'parameters.mass.factors: has a value twice'),
    ('bodies.bob.mass, values: [1, 2.5, 7]', 'bodies.bob.name, factors: [2]',
     "bodies.bob.name: factors multiply numbers that the scene has, got 'bob'"),
    ('bodies.bob.mass, values: [1, 2.5, 7]', 'bodies.bob.friction, factors: [2]',
     "bodies.bob.friction: factors multiply numbers that the scene has, got ''"),
    ('linear: [1, 2, 3]', 'uniform: [0, 2]', 'needs `random:'),
    ('bodies.bob.position.0', 'bodies.bob.mass', 'sets bodies.bob.mass, as mass does'),
    ('duration: 0.5', 'duration: 0.505', 'duration: 0.505 s is not a whole number of ticks'),
    ('duration: 0.5', 'duration: -1', 'duration: must be a finite number > 0, got -1'),
    ('duration: 0.5', '', 'duration: must be a number'),
    ('methods: [auto', 'methods: [magic', "there is no 'magic'"),
    ('methods: [auto', 'methods: [si', 'methods: a name is there twice'),
    ('iterations: 20', 'sweeps: 20', "unknown option 'sweeps'"),
    ('iterations: 20', 'time_steps: [1/50, 0]', 'methods.si.time_steps: must be a finite number > 0, got 0'),
    ('iterations: 20', 'tolerances: []', 'methods.si.tolerances: is empty'),
    ('[auto, {name: si, method: sequential_impulses, iterations: 20}]', '[{name: ode, program: none}]',
     'methods.ode.program: '),
    ('1/50', '1/0', 'time_steps: must be a finite number'),
    ('1/50', '0.3', 'duration: 0.5 s is not a whole number of ticks of 0.29999999999999999 s'),
    ('scene: scene.yaml', 'scene: missing.yaml', 'scenes.missing: cannot read'),
    ('scene: scene.yaml', '', 'must have either scene'),
    ('scene: scene.yaml', 'scene: scene.yaml\nmethod: auto', "unknown key 'method'"),
    ('scene: scene.yaml', 'scene: scene.yaml\nscene: b.yaml', 'scene: is there twice'),
    ('scene: scene.yaml', 'scene: scene.yaml\noutputs: {bodies: [cat]}', "there is no 'cat'; there are bob"),
    ('scene: scene.yaml', 'scene: scene.yaml\noutputs: {every: 0.033}', 'do not fit'),
    ('scene: scene.yaml', 'scene: scene.yaml\nreference: {run: {order: 8}}', 'needs a tolerance or a time_step'),
    ('scene: scene.yaml', 'scene: scene.yaml\nreference: {closed_form: {bob: {px: cos(w * t)}}}',
     "px: 'cos(w * t)': there is no 'w'; there are mass, pi, start, t"),
    ('scene: scene.yaml', 'scene: scene.yaml\nreference: {csv: none.csv}', 'cannot read'),
    ('scene: scene.yaml', 'scene: scene.yaml\nplots: [{x: length, y: run_time}]', "there is no 'length'"),
    ('scene: scene.yaml', 'scene: scene.yaml\nrounds: 0', 'rounds: must be a whole number >= 1, got 0'),
    ('mass:', 'method:', 'is not a name for a parameter'),
    ('[1, 2, 3]', '[1, 2, 1000000]', 'cases, more than 200000'),
    (STUDY, '[', 'not valid YAML'),
    (STUDY, '3', 'study: must be a map, got 3'),
    # names with a meaning in closed forms, or of a column
    *((f'{name}: {{', f'  {other}: {{', f'parameters.{other}: is not a name for a parameter')
      for name, other in (('  mass', 't'), ('  mass', 'pi'), ('  mass', 'sin'), ('  mass', 'outcome'),
                          ('  mass', 'sim_time'), ('  mass', 'state_hash'), ('  mass', 'warnings'),
                          ('  mass', 'methods'), ('  mass', 'reference_error'), ('  mass', 'run_time_spread'),
                          ('  mass', 'worker'), ('  mass', 'if'), ('  mass', '5'))),
    # bounds
    ('[1, 2, 3]', '[1, 2, 1000000000000]', 'must be a whole number <= 1000000, got 1000000000000'),
    ('[1, 2, 3]', '[-1e308, 1e308, 3]', 'linear spans more than numbers can'),
    ('scene: scene.yaml', 'scene: scene.yaml\nrandom: {count: 1000000000000, seed: 1}', 'random.count: must be'),
    ('scene: scene.yaml', 'scene: scene.yaml\nrandom: {count: 2, seed: 1' + '0' * 40 + '}', 'random.seed: must be'),
    ('scene: scene.yaml', 'scene: scene.yaml\nrounds: 1000000000', 'rounds: must be a whole number <= 1000'),
    ('scene: scene.yaml', 'scene: scene.yaml\noutputs: {every: 1e-300}', 'are too far from a tick'),
    ('duration: 0.5', 'duration: 1e300', 'are too far from a tick'),
    # distributions
    *(('linear: [1, 2, 3]}', f'{kind}: {numbers}}}\nrandom: {{count: 2, seed: 1}}', message)
      for kind, numbers, message in (
          ('normal', '[1, -1]', 'normal: the deviation must be >= 0'),
          ('uniform', '[2, 1]', 'uniform: the second number must not be below the first'),
          ('log_uniform', '[2, 1]', 'log_uniform: the second number must not be below the first'),
          ('uniform', '[-1e308, 1e308]', 'parameters.start.uniform: '),
          ('uniform', '[[1], 2]', 'uniform: must be a number'))),
    # malicious YAML
    (STUDY, '[' * 100000, 'lists and maps more than 32 deep'),
    (STUDY, '{a: ' * 100000, 'lists and maps more than 32 deep'),
    (STUDY, '? ' * 100000, 'lists and maps more than 32 deep'),
    (STUDY, 'a0: &a0 [1, 1]\n' + ''.join(f'a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n' for i in range(1, 60)),
     'has more than 200000 values'),
    (STUDY, 'scene: &a [*a]\n', 'has more than 200000 values'),
    (STUDY, 'scene: &a {b: *a}\n', 'has more than 200000 values'),
    (STUDY, '? [a]\n: 1\n', 'a key is a list or a map'),
    (STUDY, 'scene: 2001-99-99\n', 'not valid YAML'),
    (STUDY, 'scene: ' + '9' * 5000 + '\n', 'not valid YAML'),
    (STUDY, ''.join(f'k{i}: 1\n' for i in range(60000)), "unknown key 'k0'"),
    ('duration: 0.5', 'duration: 1' + '+1' * 5000, 'has 10001 characters, more than 1000'),
    ('duration: 0.5', 'duration: ' + '(' * 400 + '1' + ')' * 400, 'duration: must be a number'),
    ('duration: 0.5', 'duration: 1' + '0' * 900, 'duration: must be'),
    ('duration: 0.5', 'duration: {a: 1}', "duration: must be a number, got {'a': 1}"),
    ('scene: scene.yaml', 'scene: scene.yaml\nreference: {closed_form: {bob: {px: "sin(t, t)"}}}',
     'sin has 1 arguments, got 2'),
    ('scene: scene.yaml', 'scene: scene.yaml\nplots: [{x: [mass], y: run_time}]', "there is no ['mass']"),
    ('scene: scene.yaml', 'scene: scene.yaml\nreference: {csv: lines.csv}', 'reference.csv: cannot read'),
    # invalid files
    ('scene: scene.yaml', 'scene: pipe', 'scenes.pipe: cannot read'),
    ('scene: scene.yaml', 'scene: /dev/zero', 'it is no regular file'),
    ('scene: scene.yaml', 'scene: .', 'scenes.: cannot read'),
    ('scene: scene.yaml', 'scene: scene.yaml\nreference: {csv: pipe}', 'it is no regular file'),
    ('scene: scene.yaml', 'scene: "a\\0b"', 'null byte'),
)


def test_what_cannot_be_is_told_before_anything_runs(tmp_path, capsys):
    make(tmp_path)
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'lines.csv').write_text('time,body\n"' + 'x' * 200000 + '"\n')
    for old, new, message in REFUSED:
        assert old in STUDY, old
        path = make(tmp_path, STUDY.replace(old, new))
        started = time.process_time()
        assert command.main([str(path)]) == 2, (new, capsys.readouterr().err)
        assert message in capsys.readouterr().err, new
        assert time.process_time() < started + 5.0
        assert not path.with_suffix('.results').exists(), 'nothing was begun'
    for name in ('none.yaml', 'pipe', '.', 'a\0b'):
        assert command.main([str(tmp_path / name)]) == 2
        assert 'cannot read' in capsys.readouterr().err
    path = make(tmp_path)
    assert command.main([str(path), '--workers', '0']) == 2
    assert command.main([str(path), '--scene', '36']) == 2
    assert 'there are 0 to 35' in capsys.readouterr().err


def test_refused_cluster(tmp_path, capsys, monkeypatch):
    path = make(tmp_path)
    monkeypatch.setattr(executors, 'CONNECT_LIMIT', 0.3)
    assert command.main([str(path), '--cluster', 'tcp://127.0.0.1:1']) == 3
    assert 'no scheduler there' in capsys.readouterr().err


# ---- what is run

def test_each_case_is_the_runners(tmp_path, capsys):
    path = make(tmp_path / 'a')
    on_threads = sweep(path, '--on', 'threads')
    on_cluster = sweep(make(tmp_path / 'b'))
    assert len(on_threads) == 36 and untimed(on_threads) == untimed(on_cluster)
    assert [row['case'] for row in on_threads] == [str(case) for case in range(36)]
    for row in on_threads:
        assert row['outcome'] == 'ok'
        capsys.readouterr()
        command.main([str(path), '--scene', row['case']])
        assert runner_hash(capsys.readouterr().out, 0.5, tmp_path) == row['state_hash']
    first = on_threads[1]
    world = engine.load_scene_file(str(path.parent / 'scene.yaml'))
    # 1 kg at 1 m, as written, except for the tick
    world.set_options(time_step=0.02)
    world.run(0.5)
    assert (first['mass'], first['start'], first['method']) == ('1', '1.0', 'auto')
    assert float(first['bob.px']) == world.positions[0, 0]
    assert float(first['energy_final']) == world.energy


def test_checking_runs_nothing(tmp_path, capsys):
    path = make(tmp_path)
    assert command.main([str(path), '--check']) == 0
    assert capsys.readouterr().out.startswith('36 cases in 9 groups, 1 rounds, program ')
    assert not path.with_suffix('.results').exists()


def test_random_parameters(tmp_path):
    text = STUDY.replace('{path: bodies.bob.mass, values: [1, 2.5, 7]}',
                         '{path: bodies.bob.mass, log_uniform: [0.1, 10]}').replace(
        'linear: [1, 2, 3]', 'normal: [1, 0.1]') + 'random: {count: 200, seed: 4}\n'
    one, again = (study.load(make(tmp_path, text)) for _ in range(2))
    other = study.load(make(tmp_path, text.replace('seed: 4', 'seed: 5')))
    assert one.count() == 200 * 4
    points = [values for _, values in one.points()]
    assert points == [values for _, values in again.points()]
    assert points != [values for _, values in other.points()]
    logs = [math.log10(values['mass']) for values in points]
    assert -1.0 <= min(logs) and max(logs) <= 1.0
    # means of 200: 4 standard errors
    assert abs(np.mean(logs)) < 4 * 2 / math.sqrt(12 * 200)
    assert abs(np.mean([values['start'] for values in points]) - 1.0) < 4 * 0.1 / math.sqrt(200)


def test_errors_against_a_closed_form(tmp_path):
    """Free flight: x = v t, z = -g t^2 / 2 exactly; the method is exact up to rounding, and a closed form with an
    error of 1 mm shows that error."""
    scene = 'bodies:\n  - {name: ball, mass: 1, linear_velocity: [2, 0, 0]}\n'
    text = """
scene: scene.yaml
duration: 1
parameters: {v: {path: bodies.ball.linear_velocity.0, values: [2, 3]}}
outputs: {every: 0.1}
reference: {closed_form: {ball: {px: v * t, pz: -9.81 * t**2 / 2 OFF}}}
"""
    for off, error in (('', 0.0), ('+ 0.001', 0.001)):
        rows = sweep(make(tmp_path, text.replace('OFF', off), scene), '--on', 'threads')
        assert len(rows) == 2
        for row in rows:  # 4.9 m to rounding, over 100 steps
            assert abs(float(row['position_error']) - error) < 1e-13
            assert row['orientation_error'] == ''


def test_errors_against_a_tight_run_and_a_file(tmp_path):
    reference = 'reference: {run: {method: runge_kutta, tolerance: 1e-11}}\noutputs: {every: 0.1}\n'
    path = make(tmp_path, STUDY.replace('values: [1, 2.5, 7]', 'values: [1]').replace(
        'linear: [1, 2, 3]', 'values: [1]') + reference)
    tight = sweep(path, '--on', 'threads')
    csv_path = tmp_path / 'reference.csv'
    subprocess.run([RUNNER, tmp_path / 'scene.yaml', '--duration', '0.5', '--tolerance', '1e-11', '--method',
                    'runge_kutta', '--csv', csv_path], check=True, stdout=subprocess.DEVNULL)
    path.write_text(path.read_text().replace('{run: {method: runge_kutta, tolerance: 1e-11}}',
                                             '{csv: reference.csv}'))
    filed = sweep(path, '--on', 'threads')
    for one, other in zip(tight, filed):
        error = float(one['position_error'])
        assert 0.0 < float(one['reference_error']) < 1e-9, 'shorter ticks: never the same steps'
        # the reference with another tick: to its own error, 1e-11 m a second
        assert abs(error - float(other['position_error'])) < 1e-9
        assert error < 1e-7 if one['method'] == 'auto' else 1e-4 < error < 0.1


def test_orientation_error():
    """Half a turn about x against a turn by 1 mrad less."""
    from constraint_sim.sweep.child import differences
    states = np.zeros((2, 1, 13))
    reference = np.zeros((2, 1, 13))
    states[:, 0, 3:7] = math.sin(math.pi / 4), 0.0, 0.0, math.cos(math.pi / 4)
    angle = math.pi / 2 - 1e-3
    reference[:, 0, 3:7] = math.sin(angle / 2), 0.0, 0.0, math.cos(angle / 2)
    assert differences(states, reference) == pytest.approx((0.0, 1e-3), rel=1e-9)
    reference[:, 0, 3:7] *= -1.0  # equal orientation
    assert differences(states, reference)[1] == pytest.approx(1e-3, rel=1e-9)


def test_rounds_keep_the_best_time(tmp_path):
    rows = sweep(make(tmp_path, STUDY + 'rounds: 3\n'), '--on', 'threads')
    for row in rows:
        assert 0.0 < float(row['run_time']) < 1.0 and float(row['run_time_spread']) >= 0.0


def test_samples(tmp_path):
    path = make(tmp_path, STUDY.replace('values: [1, 2.5, 7]', 'values: [1]').replace(
        'linear: [1, 2, 3]', 'values: [1]') + 'outputs: {every: 0.1, samples: true}\n')
    sweep(path, '--on', 'threads')
    rows = read(path.with_suffix('.results') / 'samples.csv')
    assert len(rows) == 4 * 6
    world = engine.load_scene(SCENE)
    samples = world.run(0.5, every=10)
    assert [float(row['pz']) for row in rows if row['case'] == '0'] == list(samples.states[:, 0, 2])


# ---- what goes wrong costs what went wrong

def test_a_crash_and_a_hang_cost_one_case_each(tmp_path, monkeypatch):
    path = make(tmp_path, STUDY.replace('[1, 2.5, 7]', '[1, 13, 14, 2]').replace(
        'linear: [1, 2, 3]', 'values: [1]').replace('1/100, 1/50', '1/50') + 'time_limit: 0.5\n')
    monkeypatch.setattr(case_process, 'GRACE', 0.5)
    monkeypatch.setattr(case_process.CaseProcess, 'MODULE', 'crashing_child')
    rows = sweep(path, status=3)
    assert [row['outcome'] for row in rows] == ['ok', 'ok', 'crashed', 'crashed', 'hung', 'hung', 'ok', 'ok']
    assert 'SIGSEGV' in rows[2]['warnings'] and 'no end within 1 s' in rows[4]['warnings']
    summary = (path.with_suffix('.results') / 'summary.md').read_text()
    assert '8 cases: 2 crashed, 2 hung, 4 ok' in summary and 'case 2 crashed: mass 13' in summary


def test_too_slow_and_failed_are_outcomes(tmp_path):
    path = make(tmp_path, STUDY.replace('duration: 0.5', 'duration: 1000').replace(
        '1/100, 1/50', '1e-5').replace('[1, 2.5, 7]', '[1]').replace('linear: [1, 2, 3]', 'values: [1]')
        + 'time_limit: 0.1\n')
    assert {row['outcome'] for row in sweep(path, '--on', 'threads', status=3)} == {'too_slow'}
    scene = 'bodies:\n  - {name: bob, mass: 1, position: [9.9935e19, 0, 0], linear_velocity: [1e18, 0, 0]}\n'
    path = make(tmp_path, 'scene: scene.yaml\nduration: 10\n', scene)
    row, = sweep(path, '--on', 'threads', status=3)
    # six ticks of 1e16 m fit below the bound of 1e20 m
    assert row['outcome'] == 'failed' and row['steps'] == '6'
    assert row['warnings'] == "a body is beyond 1e20 m, m/s or rad/s: 'bob'"


def test_what_the_runner_warns_of_is_told(tmp_path):
    """Few sweeps over a rod with a heavy end leave errors, which the runner reports with exit status 4."""
    scene = """bodies:
  - {name: a, mass: 1, position: [1, 0, 0]}
  - {name: b, mass: 1000, position: [2, 0, 0]}
constraints:
  - {name: rod_a, body_b: a}
  - {name: rod_b, body_a: a, body_b: b}
"""
    text = 'scene: scene.yaml\nduration: 2\nmethods: [auto, sequential_impulses]\ntime_steps: [0.01]\n'
    path = make(tmp_path, text, scene)
    good, bad = sweep(path, '--on', 'threads')
    assert (good['outcome'], good['warnings'], good['unclosed_joints']) == ('ok', '', '0')
    found = study.load(path)
    scene, values = next(found.points())
    for case, row in zip(found.cases_at(0, scene, values), (good, bad)):
        (tmp_path / 'one.yaml').write_text(found.text_of(case))
        done = subprocess.run([RUNNER, tmp_path / 'one.yaml', '--duration', '2', '--report', tmp_path / 'one.json'],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        told = json.loads((tmp_path / 'one.json').read_text())
        assert int(row['unclosed_joints']) == len(told['unclosed_joints'])
        assert float(row['energy_rise']) == told['energy_rise']
        assert done.returncode == (4 if row is bad else 0)
    assert int(bad['unclosed_joints']) > 0 and 'errors of joints are not being closed' in bad['warnings']
    assert '1 cases: errors of joints are not being closed' in (
        path.with_suffix('.results') / 'summary.md').read_text()


def test_memory_is_limited(tmp_path):
    """Unbounded growth is ended: samples of 2 MB a tick, in the memory for 100 of them."""
    process = case_process.CaseProcess(memory=300 << 20)
    bodies = '\n'.join(f'  - {{name: b{index}, type: static}}' for index in range(20000))
    case = {'key': 'a', 'text': 'bodies:\n' + bodies, 'duration': 100.0, 'stride': 1, 'bodies': [],
            'states': [], 'keeps_samples': False}
    results = process.run({'cases': [case], 'reference': None, 'rounds': 1, 'time_limit': 60.0})
    process.stop()
    assert results['a']['outcome'] in ('crashed', 'refused'), results['a']


# ---- what was interrupted goes on

def many(folder, count=80):
    # a second or two in total, so that interruptions hit something
    return make(folder, STUDY.replace('values: [1, 2.5, 7]', f'linear: [1, 2, {count // 4}]').replace(
        'linear: [1, 2, 3]', 'values: [1]').replace('duration: 0.5', 'duration: 200'))


def test_interrupted_and_resumed_is_the_same_table(tmp_path):
    """Interrupts by Ctrl-C and by force; bench/sweep_check.py does so ten times with 2000 cases."""
    path = many(tmp_path / 'a')
    results = path.with_suffix('.results') / 'results.jsonl'
    delays, done = random.Random(3), [0]
    for number in range(2):
        process = subprocess.Popen([*COMMAND, str(path), '--no-plots', '--on', 'threads', '--workers', '2'],
                                   env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_until(lambda: results.exists() and len(results.read_bytes().splitlines()) > done[-1])
        time.sleep(delays.uniform(0.0, 0.05))  # at any moment
        process.send_signal(signal.SIGKILL if number % 2 else signal.SIGINT)
        assert process.wait(120) == (-signal.SIGKILL if number % 2 else 130), 'it was interrupted in time'
        done.append(len(results.read_bytes().splitlines()))
    assert 0 < done[1] < done[2] < 80
    with open(results, 'a') as file:
        file.write('{"key": "cut o')  # as after a full disk or a power cut
    resumed = sweep(path, '--on', 'threads')
    whole = sweep(many(tmp_path / 'b'), '--on', 'threads')
    assert untimed(resumed) == untimed(whole) and len(whole) == 80
    assert len(results.read_text().splitlines()) == 80, 'nothing was run twice'


def test_one_sweep_a_folder(tmp_path, capsys):
    path = make(tmp_path)
    held = store.Store(path.with_suffix('.results'))
    assert command.main([str(path), '--on', 'threads']) == 3
    assert 'another sweep is writing there' in capsys.readouterr().err
    held.close()
    sweep(path, '--on', 'threads')


def test_another_program_is_not_resumed(tmp_path, monkeypatch):
    path = make(tmp_path)
    sweep(path, '--on', 'threads')
    keys = [entry['key'] for job, _ in study.load(path).jobs(identity()) for entry in job['cases']]
    others = [entry['key'] for job, _ in study.load(path).jobs('other') for entry in job['cases']]
    assert not set(keys) & set(others) and len(set(keys)) == 36
    changed = STUDY.replace('duration: 0.5', 'duration: 1.0')
    others = [entry['key'] for job, _ in study.load(make(tmp_path, changed)).jobs(identity())
              for entry in job['cases']]
    assert not set(keys) & set(others)


def test_two_runs_of_other_bits_are_told(tmp_path):
    one = store.Store(tmp_path)
    one.add({'a': {'outcome': 'ok', 'state_hash': '0x1'}})
    with pytest.raises(store.StoreError, match='gave 0x1 and 0x2'):
        one.add({'a': {'outcome': 'ok', 'state_hash': '0x2'}})


def test_the_bar_tells_the_time_left(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True
    now = [100.0]
    monkeypatch.setattr(progress.time, 'monotonic', lambda: now[0])
    stream = Terminal()
    bar = progress.Progress('cases', 200, stream)
    now[0] += 50.0
    bar.step(50)  # a quarter in 50 s: 150 s remain
    assert stream.getvalue().endswith('cases [#######                       ] 50/200, about 2 min 30 s left')
    now[0] += 0.1
    bar.step(50)
    assert '100/200' not in stream.getvalue(), 'not more often than five times a second'


def test_the_bar_moves_with_each_case(tmp_path, monkeypatch):
    """Watches the progress of one group of six cases, two rounds, on threads and on a cluster."""
    text = STUDY.replace('values: [1, 2.5, 7]', 'values: [1]').replace('linear: [1, 2, 3]', 'values: [1]').replace(
        '1/100, 1/50', '1/100, 1/50, 1/20').replace('duration: 0.5', 'duration: 100') + 'rounds: 2\n'
    found = study.load(make(tmp_path, text))
    jobs = [job for job, _ in found.jobs(identity())]
    keys = [case['key'] for case in jobs[0]['cases']]
    assert len(jobs) == 1 and len(keys) == 6
    monkeypatch.setattr(progress, 'INTERVAL', 0.0)
    for run in (lambda tell: executors.on_threads(jobs, found.filled, 1, tell),
                lambda tell: executors.on_cluster(jobs, found.filled, 1, None, 0, tell)):
        bar, seen = progress.CaseProgress('cases', keys, io.StringIO()), []

        def tell(shares):
            bar.reached(shares)
            seen.append(bar.done)
        results, = run(tell)
        assert seen == [0.5 * (run + 1) for run in range(len(seen))], 'half a case each'
        # the last of twelve may come after the results
        assert set(results) == set(keys) and len(seen) >= 10
        bar.reached(dict.fromkeys(results, 1.0))
        bar.reached({keys[0]: 0.5, 'another': 1.0})
        assert bar.done == bar.total == 6


# ---- beyond one machine

class Machines:
    """A scheduler and workers as processes, as on several machines."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        self.file = folder / 'scheduler.json'
        self.start('dask-scheduler', '--host', '127.0.0.1', '--port', '0', '--no-dashboard',
                   '--scheduler-file', self.file)
        wait_until(lambda: self.file.exists() and self.file.read_text())
        self.address = json.loads(self.file.read_text())['address']

    def start(self, *words, environment=None):
        log = open(self.folder / f'process_{len(self.processes)}.log', 'w')
        self.processes.append(subprocess.Popen(
            [sys.executable, shutil.which(words[0]) or f'/usr/bin/{words[0]}', *map(str, words[1:])],
            env=environment or ENVIRONMENT, stdout=log, stderr=log, cwd=self.folder))
        return self.processes[-1]

    def worker(self, environment=None):
        return self.start('dask-worker', self.address, '--nthreads', '1', '--no-nanny', '--no-dashboard',
                          '--host', '127.0.0.1', environment=environment)

    def stop(self):
        for process in self.processes[::-1]:
            process.kill()
            process.wait()


def wait_until(condition, limit=120.0):
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def other_build(folder):
    """Returns an environment with another build of the package."""
    package = folder / 'other/constraint_sim'
    shutil.copytree(pathlib.Path(study.__file__).parents[1], package,
                    ignore=shutil.ignore_patterns('__pycache__'))
    shutil.copy(engine.__file__, package)
    with open(package / 'sweep/child.py', 'a') as file:
        file.write('# other\n')
    return {**os.environ, 'PYTHONPATH': os.pathsep.join([str(package.parent), ENVIRONMENT['PYTHONPATH']])}


def test_workers_that_die_come_late_or_are_others_lose_nothing(tmp_path, capfd):
    """A scheduler with three workers: the one with all the work is killed, one comes late, and one of another build
    gets nothing. bench/sweep_check.py has more of them, and 2000 cases."""
    machines = Machines(tmp_path)
    try:
        first = machines.worker()
        machines.worker(other_build(tmp_path))
        path = many(tmp_path / 'a', 40)
        process = subprocess.Popen([*COMMAND, str(path), '--no-plots', '--cluster', machines.address],
                                   env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        results = path.with_suffix('.results') / 'results.jsonl'
        wait_until(lambda: results.exists() and results.read_text())
        first.kill()
        assert process.poll() is None, 'nobody else could end the work'
        machines.worker()
        told = process.communicate(timeout=60)[1]
        assert process.returncode == 0, told
        assert 'is not used: it has ' in told and 'is gone' in told, told
        found = read(path.with_suffix('.results') / 'results.csv')
    finally:
        machines.stop()
    whole = sweep(many(tmp_path / 'b', 40), '--on', 'threads')
    assert untimed(found) == untimed(whole) and len(found) == 40


def test_a_worker_of_another_program_gives_nothing():
    assert executors.run_batch([], 'another 1', 0, 'topic') == (identity(), {})


# ---- pages

def test_times_of_different_machines_are_not_compared():
    """The diagram takes times of the machine that ran most; a page of a scene says that there are several."""
    row = {'scene': 's', 'method': 'auto', 'tolerance': None, 'outcome': 'ok', 'position_error': 1e-3}
    table = [{**row, 'time_step': 0.01, 'run_time': 1.0, 'worker': 'one'},
             {**row, 'time_step': 0.02, 'run_time': 0.5, 'worker': 'one'},
             {**row, 'time_step': 0.03, 'run_time': 0.1, 'worker': 'two'}]
    assert pages.work_precision(table) == ({('s', 'auto'): [(0.5, 1e-3), (1.0, 1e-3)]}, 2)
    assert pages.work_precision(table[:2])[1] == 1


def test_pages_and_limits(tmp_path, capsys):
    path = make(tmp_path, STUDY + """
reference: {run: {method: runge_kutta, tolerance: 1e-11}}
outputs: {every: 0.1}
limits: [{of: start, error: position_error, below: 1e-6}]
""")
    assert command.main([str(path), '--on', 'threads']) == 0
    out = capsys.readouterr().out
    assert 'auto, 0.01, 1: position_error stays below 1e-06 at every start, up to 2' in out
    assert 'si, 0.01, 1: position_error is not below 1e-06 even at the least start, 1' in out
    folder = path.with_suffix('.results')
    page = (folder / 'index.html').read_text()
    plots = sorted(folder.glob('*.svg'))
    assert {plot.name for plot in plots} == {
        'work_precision_scene.svg', 'position_error_over_mass_scene.svg',
        'position_error_over_start_scene.svg', 'outcome_scene_auto.svg', 'outcome_scene_si.svg'}
    for plot in plots:
        assert plot.stat().st_size > 5000 and plot.name in page


def test_parquet_where_pyarrow_is(tmp_path, monkeypatch):
    """The format depends on pyarrow alone; here a stand-in receives the columns."""
    table = [{'case': 0, 'a': 1.5, 'b': 'x'}, {'case': 1, 'a': None, 'b': 'y'}]
    monkeypatch.setattr(tables, 'pyarrow', None)
    assert tables.write(tmp_path, 'one', table).name == 'one.csv'
    assert (tmp_path / 'one.csv').read_text() == 'case,a,b\n0,1.5,x\n1,,y\n'
    written = {}

    class Stand:
        @staticmethod
        def table(data):
            written.update(data)
            return data

        class parquet:
            @staticmethod
            def write_table(data, path):
                path.write_bytes(b'')
    monkeypatch.setattr(tables, 'pyarrow', Stand)
    assert tables.write(tmp_path, 'one', table).name == 'one.parquet'
    assert written == {'case': [0, 1], 'a': [1.5, None], 'b': ['x', 'y']}


def test_methods_may_have_ticks_and_tolerances_of_their_own(tmp_path):
    text = STUDY.replace('methods: [auto, {name: si, method: sequential_impulses, iterations: 20}]', """
methods:
  - {name: tight, method: auto, tolerances: [1e-3, 1e-6], time_steps: 0.1}
  - {name: si, method: sequential_impulses}
""").replace('[1, 2.5, 7]', '[1]').replace('linear: [1, 2, 3]', 'values: [1]')
    rows = sweep(make(tmp_path, text), '--on', 'threads')
    assert [(row['method'], row['time_step'], row['tolerance']) for row in rows] == [
        ('tight', '0.1', '0.001'), ('tight', '0.1', '1e-06'), ('si', '0.01', ''), ('si', '0.02', '')]


def test_factors_multiply_what_the_scene_has(tmp_path):
    scene = """bodies:
  - {name: a, mass: 2, inertia: [1, 2, 2.5]}
  - {name: b, mass: 3}
"""
    text = """
scene: scene.yaml
duration: 0.1
parameters: {heavier: {path: [bodies.*.mass, bodies.a.inertia], factors: [1, 1e3]}}
"""
    study_ = study.load(make(tmp_path, text, scene))
    (_, one), (_, other) = study_.points()
    texts = [study_.text_of(case) for values in (one, other) for case in study_.cases_at(0, 'scene', values)]
    worlds = [engine.load_scene(text) for text in texts]
    assert [world.body('b')['mass'] for world in worlds] == [3.0, 3000.0]
    assert [world.body('a')['mass'] for world in worlds] == [2.0, 2000.0]
    assert worlds[1].body('a')['inertia'] == (1000.0, 2000.0, 2500.0)


def test_energy_is_held_against_the_reference(tmp_path):
    """A ball falls 4.905 m in 1 s; a damped spring loses energy, which is no error."""
    ball = 'bodies:\n  - {name: ball, mass: 1}\n'
    reference = 'reference: {run: {method: runge_kutta, tolerance: 1e-11}}\noutputs: {every: 0.1}\n'
    text = 'scene: scene.yaml\nduration: 1\nmethods: [auto]\n' + reference
    row, = sweep(make(tmp_path / 'a', text, ball), '--on', 'threads')
    assert float(row['distance']) == pytest.approx(4.905, rel=1e-12)  # rounding over 60 steps
    assert float(row['scene_size']) == pytest.approx(4.905, rel=1e-12)
    assert float(row['energy_error']) < 1e-13
    damped = SCENE.replace('type: distance', 'type: distance\n    stiffness: 100\n    damping: 5')
    row, = sweep(make(tmp_path / 'b', text, damped), '--on', 'threads')
    # errors are of the order of the tolerance, 1e-8
    assert float(row['energy_drift']) < -0.01 and float(row['energy_error']) < 1e-6


# ---- a scene of one's own by --report

def test_report_of_a_scene(tmp_path, capsys):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(SCENE)
    assert command.main([str(scene), '--report', '--duration', '0.5', '--on', 'threads']) == 0
    folder = scene.with_suffix('.results')
    rows = read(folder / 'results.csv')
    assert len(rows) == 3 * 12 + 5 * 8 and {row['outcome'] for row in rows} == {'ok'}
    by_method = {row['method']: float(row['position_error']) for row in rows if row['time_step'] == '0.001'}
    # second and first order of the tick, and a tolerance of 1e-8 m a second
    assert by_method['auto_by_tick'] < 1e-8 < by_method['energy_momentum_order_2'] < 1e-4
    assert by_method['energy_momentum_order_2'] < by_method['sequential_impulses_10'] < 1e-2
    by_tolerance = {row['tolerance']: float(row['position_error']) for row in rows if row['method'] == 'auto'}
    assert by_tolerance['1e-10'] < 1e-9 < by_tolerance['0.001'] < 1e-2
    # one body, no spring: the unchanged scene
    stability = read(folder / 'stability.csv')
    assert len(stability) == 7 * 6 and [row['case'] for row in stability[:2]] == ['76', '77']
    text = (folder / 'summary.md').read_text()
    for method in {row['method'] for row in rows}:
        least = min(max(float(row['position_error']), float(row['orientation_error'])) for row in rows
                    if row['method'] == method)
        line, = (line for line in text.splitlines() if line.startswith(f'| scene | constraint_sim {method} |'))
        assert line.split(' | ')[-1] == f'{least:.3g} |'
    assert '| constraint_sim runge_kutta_order_8 | 6 |' in text, 'exact at each tick'
    assert 'A peer wins' not in text
    page = (folder / 'index.html').read_text()
    assert 'src="scene.svg"' in page and (folder / 'scene.svg').stat().st_size > 5000
    assert page.count('<td class="') == 7 * 6 and 'A cell is one run of 0.5 s' in page
    capsys.readouterr()
    assert command.main([str(scene), '--report', '--duration', '0.5', '--scene', '76']) == 0
    assert 'time_step: 0.5' in capsys.readouterr().out


def test_report_of_what_never_errs(tmp_path):
    """A scene without motion has nothing to draw, and no size."""
    scene = tmp_path / 'scene.yaml'
    scene.write_text('bodies:\n  - {name: rock, type: static}\n')
    assert command.main([str(scene), '--report', '--duration', '0.1', '--on', 'threads']) == 0
    folder = scene.with_suffix('.results')
    assert not (folder / 'scene.svg').exists() and '.svg' not in (folder / 'index.html').read_text()
    assert '| constraint_sim auto | 5 |' in (folder / 'summary.md').read_text()


def test_report_makes_loads_heavier_and_springs_stiffer(tmp_path):
    path = tmp_path / 'scene.yaml'
    path.write_text("""bodies:
  - {name: the.load, mass: 20, inertia: [1, 1, 1], position: [1, 0, 0]}
  - {name: bob, mass: 1, position: [2, 0, 0]}
  - {name: floor, type: static, mass: 1000}
constraints:
  - {name: rod, type: distance, body_b: the.load}
  - {name: spring, type: distance, body_a: the.load, body_b: bob, stiffness: 300}
""")
    found = report.studies_of(path, 1.0, {})
    plain, heavier, stiffer = found.grid
    assert (found.diagram.first, plain.first, heavier.first) == (0, 76, 76 + 42) and not found.notes
    worlds = {}
    for each in (heavier, stiffer):
        for scene, values in each.points():
            case = next(each.cases_at(0, scene, values))
            worlds[report.grid_case(each, case.values)] = engine.load_scene(each.text_of(case))
    assert {case: (world.body('the.load')['mass'], world.body('the.load')['inertia'][0], world.body('bob')['mass'],
                   world.joint('spring')['stiffness']) for case, world in worlds.items()} == {
        'mass_of_the_load × 0.001': (0.02, 0.001, 1.0, 300.0),
        'mass_of_the_load × 1000': (20e3, 1e3, 1.0, 300.0),
        'mass_of_the_load × 1e+06': (20e6, 1e6, 1.0, 300.0),
        'stiffness × 1000': (20.0, 1.0, 1.0, 3e5), 'stiffness × 1e+06': (20.0, 1.0, 1.0, 3e8)}
    text = path.read_text()
    path.write_text(text.replace('stiffness: 300', 'stiffness: *k').replace(
        'body_b: the.load}', 'body_b: the.load, stiffness: &k 300}'))
    found = report.studies_of(path, 1.0, {})
    assert len(found.grid) == 2
    assert found.notes == ['stiffness is not varied: constraints.rod.stiffness: constraints.rod.stiffness is a YAML '
                           'alias, used in several places']


def test_outcomes_of_a_report_are_those_of_the_report(tmp_path):
    """Reports of the engine itself are distinguished from observations of a peer."""
    path = make(tmp_path, 'scene: scene.yaml\nduration: 1\nmethods: [auto]\ntime_steps: [0.1]\n')
    found = study.load(path)
    found.methods.append(study.Method('other', {}, 'other x'))
    row = {'method': 'auto', 'outcome': 'failed', 'time_step': 0.1, 'tolerance': None}
    rows = report.report_rows(found, [row, {**row, 'method': 'other'}, {
        **row, 'outcome': 'ok', 'run_time': 0.002, 'sim_time': 2.0, 'position_error': 0.5,
        'max_constraint_error': 1e-3}], lambda row: 'p')
    assert [row['contestant'] for row in rows] == ['constraint_sim auto', 'other x', 'constraint_sim auto']
    grid = figures.verdicts(rows, {'p': report.Scene('', 0.01, False, False)})
    assert [kind for _, kind, _ in grid['p']['constraint_sim auto']] == ['refused', 'exploded']  # 50 times its size
    assert [kind for _, kind, _ in grid['p']['other x']] == ['exploded']
    assert rows[2]['run_time'] == 1000.0, 'microseconds a second'


def test_what_no_sweep_wrote_stays(tmp_path, capsys):
    path = make(tmp_path / 'a')
    folder = tmp_path / 'mine'
    folder.mkdir()
    (folder / 'index.html').write_text('mine')
    for words in ([str(path)], [str(path.with_name('scene.yaml')), '--report']):
        for output in (folder, folder / 'index.html'):
            assert command.main([*words, '--on', 'threads', '--output', str(output)]) == 2
            assert 'is there and no sweep wrote it' in capsys.readouterr().err
    assert [file.name for file in folder.iterdir()] == ['index.html']
    assert (folder / 'index.html').read_text() == 'mine'
    assert command.main([str(path.with_name('scene.yaml')), '--report', '--duration', '0.25']) == 2
    assert '--duration: must be a multiple of 0.1 s, got 0.25' in capsys.readouterr().err


def other_engine(folder):
    """Makes a peer with another name that runs this engine's `auto`."""
    program = folder / 'constraint_sim_report_other'
    ours = report_programs() / 'constraint_sim_report_engine'
    program.write_text(f"""#!/bin/sh
if [ "$1" = list ]; then {ours} list | grep ^auto | sed 's/constraint_sim/other/'; else exec {ours} "$@"; fi
""")
    program.chmod(0o755)
    return program


def test_peers_stand_in_the_report_of_a_scene(tmp_path, capsys):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(SCENE)
    other_engine(tmp_path)
    assert command.main([str(scene), '--report', '--duration', '0.2', '--on', 'threads', '--peers', str(tmp_path)]) == 0
    text = (scene.with_suffix('.results') / 'summary.md').read_text()
    assert 'A peer wins: ' in text and '| other auto | 5 |' in text, 'exact at each tick'
    rows = read(scene.with_suffix('.results') / 'results.csv')
    own, other = ([row['bob.px'] for row in rows if row['method'] == name] for name in ('auto_by_tick', 'other_auto'))
    assert own == other and len(own) == 8


def test_a_study_names_programs_of_its_own(tmp_path, capsys):
    program = other_engine(tmp_path)
    text = STUDY.replace('[auto, {name: si, method: sequential_impulses, iterations: 20}]', f"""
  - auto
  - {{name: one, program: {program.name}}}
  - {{name: two, program: {program.name}, peer: other auto, time_steps: [0.05]}}""")
    rows = sweep(make(tmp_path, text), '--on', 'threads')
    assert len(rows) == 9 * (2 + 2 + 1)
    for start in range(0, 45, 5):
        (auto, _, one, _, two) = rows[start:start + 5]
        assert [row['method'] for row in (auto, one, two)] == ['auto', 'one', 'two'] and two['time_step'] == '0.05'
        assert auto['bob.px'] == one['bob.px']
    path = make(tmp_path, text.replace('other auto', 'other magic'))
    assert command.main([str(path)]) == 2
    assert "methods.two: there is no peer 'other magic'; there are other auto" in capsys.readouterr().err
    assert command.main([str(make(tmp_path, text)), '--cluster', 'tcp://127.0.0.1:1']) == 2
    assert 'the programs of peers are on this machine' in capsys.readouterr().err


def report_programs():
    program, = pathlib.Path(os.environ['CONSTRAINT_SIM_BUILD']).rglob('constraint_sim_report_engine')
    return program.parent


def test_peers_are_methods(tmp_path, capsys):
    """This engine by its adapter of the report has the bits of this engine by the module."""
    text = STUDY.replace('methods: [auto, {name: si, method: sequential_impulses, iterations: 20}]', """
methods:
  - {name: si, method: sequential_impulses, iterations: 10}
  - {name: peer, peer: constraint_sim sequential_impulses_10}
""") + 'reference: {run: {method: runge_kutta, tolerance: 1e-11}}\noutputs: {every: 0.1}\n'
    path = make(tmp_path, text)
    rows = sweep(path, '--on', 'threads', '--peers', str(report_programs()))
    assert len(rows) == 36
    pairs = {}
    for row in rows:
        pairs.setdefault((row['mass'], row['start'], row['time_step']), []).append(row)
    for ours, peer in pairs.values():
        for name in ('position_error', 'bob.px', 'bob.pz', 'bob.vx', 'bob.vz', 'steps', 'sim_time'):
            assert ours[name] == peer[name], name
    assert command.main([str(path)]) == 2
    assert 'there are none without --peers' in capsys.readouterr().err
    path.write_text(text.replace('impulses_10', 'impulses_11'))
    assert command.main([str(path), '--peers', str(report_programs())]) == 2
    assert "there is no peer 'constraint_sim sequential_impulses_11'; there are constraint_sim auto" in \
        capsys.readouterr().err
    assert command.main([str(path), '--peers', str(tmp_path)]) == 2
    assert 'no program' in capsys.readouterr().err


def test_another_engine_is_held_against_this_one(tmp_path):
    """A program with the equation of the pendulum, independent of constraint_sim, has known errors: rounding, and
    those of explicit Euler, first order in the tick."""
    shutil.copy(SOURCES / 'test/python/pendulum_peer.py', tmp_path)
    text = STUDY.replace('methods: [auto, {name: si, method: sequential_impulses, iterations: 20}]', """
methods:
  - auto
  - {name: tight, program: pendulum_peer.py, peer: pendulum tight}
  - {name: euler, program: pendulum_peer.py, peer: pendulum euler, time_steps: [1/1000, 1/2000]}
""") + 'reference: {run: {method: runge_kutta, tolerance: 1e-11}}\noutputs: {every: 0.1}\n'
    rows = sweep(make(tmp_path, text))
    assert len(rows) == 9 * 6 and {row['outcome'] for row in rows} == {'ok'}
    for start in range(0, 54, 6):
        auto, _, tight, _, coarse, fine = rows[start:start + 6]
        # rounding of 500 steps; steps of 1 ms of order 4 have errors of 1e-12 m
        assert float(tight['position_error']) < 1e-10
        assert abs(float(tight['bob.vz']) - float(auto['bob.vz'])) < 1e-9
        # dt times half the integral of the acceleration's rate, at most 1 s² of 10 m/s³, amplified by less than 10
        assert 1e-5 < float(fine['position_error']) < 0.05
        assert float(coarse['position_error']) / float(fine['position_error']) == pytest.approx(2.0, rel=0.02)


def test_another_engine_that_crashes_costs_its_cases(tmp_path):
    shutil.copy(SOURCES / 'test/python/pendulum_peer.py', tmp_path)
    text = """
scene: scene.yaml
duration: 0.2
parameters: {stiffness: {path: constraints.rod.a.stiffness, values: [.inf, 100]}}
methods: [auto, {name: bad, program: pendulum_peer.py, peer: pendulum crash},
          {name: tight, program: pendulum_peer.py, peer: pendulum tight}]
"""
    rows = sweep(make(tmp_path, text.replace('[.inf, 100]', '[100]')), status=3)
    assert [(row['outcome'], row['warnings']) for row in rows] == [
        ('ok', ''), ('crashed', 'signal SIGABRT'), ('unsupported', 'scene: is not one body on a rod')]


def test_programs_that_are_built_are_methods(tmp_path):
    """With all contestants of the built programs a pendulum converges with the tick."""
    found = peers.found_in(report_programs())
    assert 'constraint_sim auto' in found
    listed = ''.join(f"\n  - {{name: '{label}', peer: {label}}}" for label in found)
    text = STUDY.replace(' [auto, {name: si, method: sequential_impulses, iterations: 20}]', listed).replace(
        '[1, 2.5, 7]', '[1]').replace('linear: [1, 2, 3]', 'values: [1]').replace('1/100, 1/50', '1/100, 1/1000')
    rows = sweep(make(tmp_path, text + 'reference: {run: {method: runge_kutta, tolerance: 1e-11}}\n'),
                 '--on', 'threads', '--peers', str(report_programs()))
    assert len(rows) == 2 * len(found) and {row['outcome'] for row in rows} == {'ok'}
    errors = [[float(row['position_error']) for row in rows[at:at + 2]] for at in range(0, len(rows), 2)]
    for label, (coarse, fine) in zip(found, errors):
        # first order or better: a tenth, with a third for higher orders of the tick
        assert fine < coarse / 7.0 or coarse < 1e-7, label


def exported(part, problem, folder):
    subprocess.run([sys.executable, SOURCES / 'bench/report/export_study.py', part, problem, '--programs',
                    report_programs(), '--output', folder], check=True, env=ENVIRONMENT, stdout=subprocess.DEVNULL)
    return folder / f'{problem}.yaml'


def test_a_problem_of_the_report_is_a_study(tmp_path):
    """Errors of an exported study against the report's own reference equal those of the report, to the printed
    digits, for each contestant of the built programs."""
    path = exported('grid', 'four_bar_1', tmp_path)
    ticks = [0.5, 0.1, 1 / 30, 1 / 60, 1 / 240, 1 / 1000]
    assert [float(row) for row in study.load(path, peers.found_in(report_programs())).time_steps] == ticks
    text = path.read_text()
    path.write_text(text[:text.index('time_steps:')] + 'time_steps: [0.1, 1/60]\n' + text[text.index('outputs:'):])
    rows = sweep(path, '--on', 'threads', '--peers', str(report_programs()))
    found = peers.found_in(report_programs())
    assert len(rows) == 2 * len(found) and {row['outcome'] for row in rows} == {'ok'}
    subprocess.run([report_programs() / 'constraint_sim_report_engine', 'references', tmp_path, '--problem',
                    'four_bar_1'], check=True, stdout=subprocess.DEVNULL)
    measured = []
    for peer in found.values():
        said = subprocess.run([peer.program, 'run', tmp_path, '--problem', 'four_bar_1', '--variant', peer.variant,
                               '--grid', '--values', '0.1', repr(1 / 60), '--budget', '10', '--repeats', '1'],
                              check=True, text=True, stdout=subprocess.PIPE).stdout
        measured += [float(line.split(',')[8]) for line in said.splitlines() if line.startswith('four_bar_1')]
    # the scene's numbers may be off by 4 ulp, which a loop at singular positions amplifies
    assert [float(row['position_error']) for row in rows] == pytest.approx(measured, rel=6e-3, abs=1e-9)


def test_a_diagram_of_the_report_is_a_study(tmp_path, capsys):
    path = exported('diagrams', 'heavy_chain_1e3', tmp_path)
    found = study.load(path, peers.found_in(report_programs()))
    assert found.bodies == ['body_10'] and found.duration == 5.0 and list(found.reference) == ['csv']
    assert command.main([str(path), '--check', '--peers', str(report_programs())]) == 0
    assert capsys.readouterr().out.startswith(f'{found.count()} cases in 1 groups, 4 rounds, program ')
    with pytest.raises(subprocess.CalledProcessError):
        exported('grid', 'none', tmp_path)


def test_what_a_peer_cannot_express_is_told(tmp_path):
    text = """
scene: scene.yaml
duration: 0.2
parameters: {damping: {path: constraints.rod.a.damping, values: [0, 1]}}
methods: [{name: peer, peer: constraint_sim auto}]
"""
    path = make(tmp_path, text, SCENE.replace('type: distance', 'type: distance\n    stiffness: 100'))
    good, damped = sweep(path, '--on', 'threads', '--peers', str(report_programs()))
    assert (good['outcome'], damped['outcome']) == ('ok', 'unsupported')
    assert damped['warnings'] == 'rod.a: is damped'
    summary = (path.with_suffix('.results') / 'summary.md').read_text()
    assert 'peer cannot express the scene: rod.a: is damped' in summary


def test_studies_of_the_manual(tmp_path, capsys):
    """All studies of the manual run; the first question has the answer in docs/sweeps.md."""
    manual = (SOURCES / 'docs/sweeps.md').read_text()
    paths = sorted((SOURCES / 'docs/studies').glob('*.yaml'))
    for path in paths:
        if 'duration:' not in path.read_text():
            continue  # a scene
        assert len(path.read_text().splitlines()) <= 20
        assert command.main([str(path), '--on', 'threads', '--output', str(tmp_path / path.stem)]) == 0
        out = capsys.readouterr().out
        for line in out.splitlines()[1:-1]:
            if 'stays below' in line or 'not below' in line:
                assert line in manual, line
    scene = SOURCES / 'docs/studies/hanging_chain.yaml'
    assert command.main([str(scene), '--report', '--duration', '1', '--no-plots', '--on', 'threads', '--output',
                         str(tmp_path / 'report')]) == 0
    for line in capsys.readouterr().out.splitlines()[:-1]:
        assert line in manual, line
    block = manual.split('```yaml\n')[1].split('```')[0]
    assert block == (SOURCES / 'docs/studies/how_heavy.yaml').read_text()
