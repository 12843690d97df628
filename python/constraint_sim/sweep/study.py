"""A study file: what is run, checked as a whole before anything runs. docs/sweeps.md is the manual."""
import collections
import csv
import hashlib
import io
import itertools
import json
import keyword
import math
import pathlib
import subprocess
import zlib

import numpy as np

from .. import engine
from . import expressions, peers
from .child import COMPONENTS
from .scene_template import PathError, SceneTemplate
from .study_values import (MOST_VALUES, StudyError, expect_keys, listed, load_yaml, number, read_text,
                           scene_value, shown, spread, whole)

# columns of the table that are not parameters
INDEX = ('case', 'scene')
CHOICES = ('method', 'time_step', 'tolerance')
MEASURES = ('position_error', 'orientation_error', 'max_constraint_error', 'max_penetration',
            'distance', 'scene_size', 'accumulated_local_error', 'energy_initial', 'energy_final', 'energy_drift',
            'energy_error', 'correction_work', 'driven_work', 'solver_residual', 'run_time', 'steps', 'substeps',
            'rejected', 'iterations', 'rows', 'contacts', 'changes', 'energy_rise', 'unclosed_joints',
            'torn_joints', 'unresolved_bodies')
OTHERS = ('outcome', 'sim_time', 'state_hash', 'reference_error', 'methods', 'warnings', 'run_time_spread',
          'worker', 'key', 'samples')  # further columns of results
MOST_CASES = 200_000  # the table of cases is kept in memory
MOST_ROUNDS = 1000
MOST_CSV_BYTES = 256 << 20
MOST_TICKS = 2 ** 53  # a double counts no further

# time_steps, tolerances: of the method's own; None: those of the study. peer: ENGINE VARIANT, of `program` or --peers
Method = collections.namedtuple('Method', 'name options peer time_steps tolerances program',
                                defaults=(None, None, None, None))
Parameter = collections.namedtuple('Parameter', 'name paths values draw is_logarithmic is_factor',
                                   defaults=(False,))
Case = collections.namedtuple('Case', 'index scene values method time_step tolerance')


DRAWS = {'uniform': lambda random, a, b, n: random.uniform(a, b, n),
         'normal': lambda random, a, b, n: random.normal(a, b, n),
         'log_uniform': lambda random, a, b, n: np.exp(random.uniform(np.log(a), np.log(b), n))}
KINDS = ('values', 'factors', 'linear', 'logarithmic', *DRAWS)


def parameter(name, value, draws):
    where = f'parameters.{name}'
    expect_keys(where, value, ('path', *KINDS))
    if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name) or \
            name in (*INDEX, *CHOICES, *MEASURES, *OTHERS) or name in expressions.RESERVED:
        raise StudyError(f'{where}: is not a name for a parameter, or means something else')
    paths = [str(path) for path in listed(f'{where}.path', value.get('path', []))]
    kinds = [kind for kind in KINDS if kind in value]
    if len(kinds) != 1:
        raise StudyError(f'{where}: must have one of ' + ', '.join(KINDS))
    kind, given = kinds[0], value[kinds[0]]
    if kind in ('values', 'factors'):
        read = scene_value if kind == 'values' else number
        values = [read(f'{where}.{kind}', element) for element in listed(f'{where}.{kind}', given)]
        if len(set(values)) < len(values):
            raise StudyError(f'{where}.{kind}: has a value twice')
        return Parameter(name, paths, values, False, False, kind == 'factors')
    if kind in ('linear', 'logarithmic'):
        values = spread(where, kind, given, math.log if kind == 'logarithmic' else float)
        return Parameter(name, paths, values, False, kind == 'logarithmic')
    if not isinstance(given, list) or len(given) != 2:
        raise StudyError(f'{where}.{kind}: must be two numbers, got {shown(given)}')
    if draws is None:
        raise StudyError(f'{where}.{kind}: needs `random: {{count: N, seed: S}}` in the study')
    least = 0.0 if kind == 'log_uniform' else -math.inf
    a, b = (number(f'{where}.{kind}', element, least) for element in given)
    if b < (0.0 if kind == 'normal' else a):
        raise StudyError(f'{where}.{kind}: ' + ('the deviation must be >= 0' if kind == 'normal' else
                                                'the second number must not be below the first')
                         + f', got {shown(given)}')
    # a stream of its own: another parameter changes none of these
    random = np.random.default_rng([draws['seed'], zlib.crc32(name.encode())])
    try:
        values = [float(drawn) for drawn in DRAWS[kind](random, a, b, draws['count'])]
    except (ValueError, OverflowError) as error:
        raise StudyError(f'{where}.{kind}: {error}') from None
    if not all(math.isfinite(drawn) for drawn in values):
        raise StudyError(f'{where}.{kind}: draws numbers that are not finite, got {shown(given)}')
    return Parameter(name, paths, values, True, kind == 'log_uniform')


def method(value):
    if isinstance(value, str):
        return Method(value, {'method': value})
    if not isinstance(value, dict) or not isinstance(value.get('name'), str):
        raise StudyError(f'methods: must be names, or maps with a name and options, got {shown(value)}')
    where = f'methods.{value["name"]}'
    own = {key: [number(f'{where}.{key}', element, least) for element in listed(f'{where}.{key}', value[key])]
           for key, least in (('time_steps', 0.0), ('tolerances', -math.inf)) if key in value}
    if 'peer' in value or 'program' in value:
        expect_keys(where, value, ('name', 'peer', 'program', 'time_steps'))
        return Method(value['name'], {}, str(value.get('peer', '')), program=value.get('program'), **own)
    options = {key: element for key, element in value.items() if key not in ('name', *own)}
    return Method(value['name'], world_options(where, options), **own)


def world_options(where, options):
    known = engine.World().options
    found = {}
    for key, value in options.items():
        if key not in known:
            raise StudyError(f'{where}: unknown option {shown(key)}; there are ' + ', '.join(known))
        found[key] = scene_value(f'{where}.{key}', value)
    return found


STUDY_KEYS = ('scene', 'scenes', 'duration', 'parameters', 'random', 'methods', 'time_steps', 'tolerances',
              'outputs', 'reference', 'rounds', 'time_limit', 'memory', 'plots', 'limits')


class Study:
    """The contents of a study file. Throws StudyError for invalid values."""

    def __init__(self, text, folder, source='study', known_peers=None, first=0):
        """`known_peers`: those of other engines that methods may name; `first`: the number of its first case."""
        self.source, self.folder, self.peers, self.first = source, pathlib.Path(folder), known_peers or {}, first
        self.peer_of = {}
        document = load_yaml(text)
        expect_keys('study', document, STUDY_KEYS)
        self.read_scenes(document)
        self.duration = number('duration', document.get('duration', 'missing'), 0.0)
        draws = document.get('random')
        if draws is not None:
            expect_keys('random', draws, ('count', 'seed'))
            draws = {key: whole(f'random.{key}', draws.get(key), least, most)
                     for key, least, most in (('count', 1, MOST_VALUES), ('seed', 0, 2 ** 64 - 1))}
        self.parameters = [parameter(name, value, draws) for name, value in
                           (expect_any('parameters', document.get('parameters', {}))).items()]
        if draws and not any(each.draw for each in self.parameters):
            raise StudyError('random: no parameter is drawn')
        self.methods = [method(value) for value in
                        listed('methods', document.get('methods', ['as_written']))]
        if 'methods' not in document:
            self.methods = [Method('as_written', {})]
        names = [each.name for each in self.methods]
        if len(set(names)) < len(names):
            raise StudyError('methods: a name is there twice; give one a name of its own')
        self.methods = [each if each.peer is None else each._replace(peer=self.peer_named(each))
                        for each in self.methods]
        self.time_steps = [number('time_steps', value, 0.0) for value in
                           listed('time_steps', document['time_steps'])] \
            if 'time_steps' in document else [None]
        self.tolerances = [number('tolerances', value) for value in
                           listed('tolerances', document['tolerances'])] \
            if 'tolerances' in document else [None]
        if 'tolerances' in document and any(each.peer for each in self.methods):
            raise StudyError('tolerances: peers know none; give methods of their own a tolerance each')
        self.rounds = whole('rounds', document.get('rounds', 1), 1, MOST_ROUNDS)
        self.time_limit = number('time_limit', document.get('time_limit', 60.0), 0.0)
        self.memory = whole('memory', document.get('memory', 4 << 30), 0, 1 << 50)
        outputs = expect_keys('outputs', document.get('outputs', {}), ('bodies', 'every', 'samples'))
        self.bodies = outputs.get('bodies')
        self.every = number('outputs.every', outputs['every'], 0.0) if 'every' in outputs else None
        self.keeps_samples = outputs.get('samples', False) is True
        self.read_reference(document.get('reference'))
        self.plots = document.get('plots')
        self.limits = document.get('limits')
        self.check_plots()
        count = self.count()
        if count > MOST_CASES:
            raise StudyError(f'study: has {count} cases, more than {MOST_CASES}')

    def peer_named(self, method):
        """Returns the peer of a method, from `program` or --peers; the only one need not be named."""
        known = self.peers
        if method.program is not None:
            path = self.folder / str(method.program)
            try:
                known = peers.of_program(path)
            except (OSError, ValueError, subprocess.SubprocessError) as error:
                raise StudyError(f'methods.{method.name}.program: {path} is no program of the report: '
                                 f'{error}') from None
        label = method.peer or (next(iter(known)) if len(known) == 1 else '')
        if label not in known:
            raise StudyError(f'methods.{method.name}: there is no peer {label!r}; there are '
                             + (', '.join(known) or 'none without --peers'))
        self.peer_of[method.name] = known[label]
        return label

    def read_scenes(self, document):
        if ('scene' in document) == ('scenes' in document):
            raise StudyError('study: must have either scene, a file, or scenes, a map of names to files')
        files = document.get('scenes') or document.get('scene')
        if isinstance(files, str):
            files = {pathlib.Path(files).stem: files}
        if not isinstance(files, dict) or not files:
            raise StudyError(f'scenes: must be a map of names to files, got {shown(files)}')
        self.scenes = {}
        for name, file in files.items():
            path = self.folder / str(file)
            try:
                text = read_text(path)
                engine.load_scene(text, str(file))
                self.scenes[str(name)] = SceneTemplate(text, str(file))
            except (OSError, UnicodeDecodeError) as error:
                raise StudyError(f'scenes.{name}: cannot read {path}: {error}') from None
            except ValueError as error:
                raise StudyError(f'scenes.{name}: {error}') from None

    def read_reference(self, reference):
        self.reference = None
        if reference is None:
            return
        expect_keys('reference', reference, ('run', 'closed_form', 'csv'))
        if len(reference) != 1:
            raise StudyError('reference: must have one of run, closed_form, csv')
        kind, value = next(iter(reference.items()))
        if kind == 'run':
            options = world_options('reference.run', expect_any('reference.run', value))
            if 'tolerance' not in options and 'time_step' not in options:
                raise StudyError('reference.run: needs a tolerance or a time_step of its own')
            value = options
        elif kind == 'closed_form':
            variables = {expressions.TIME, *(each.name for each in self.parameters)}
            for body, components in expect_any('reference.closed_form', value).items():
                expect_keys(f'reference.closed_form.{body}', components, COMPONENTS)
                for component, text in components.items():
                    where = f'reference.closed_form.{body}.{component}'
                    try:
                        expressions.value(text, dict.fromkeys(variables, np.ones(2)))
                    except expressions.ExpressionError as error:
                        raise StudyError(f'{where}: {error}') from None
        else:
            value = self.read_csv(value)
        self.reference = {kind: value}

    def read_csv(self, file):
        """A trajectory as the runner writes it."""
        rows = collections.defaultdict(dict)
        try:
            for row in csv.DictReader(io.StringIO(read_text(self.folder / str(file), MOST_CSV_BYTES), newline='')):
                rows[float(row['time'])][row['body']] = [float(row[name]) for name in COMPONENTS]
        except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
            raise StudyError(f'reference.csv: cannot read {shown(file)}: {error}') from None
        if not rows:
            raise StudyError(f'reference.csv: {shown(file)} is empty')
        if not all(math.isfinite(time) for time in rows):
            raise StudyError(f'reference.csv: {shown(file)} has a time that is no number')
        return dict(rows)

    def check_plots(self):
        """Only columns that there will be."""
        axes = {*MEASURES, *CHOICES, *(each.name for each in self.parameters)}
        for where, entries, keys, needed in (
                ('plots', self.plots, ('x', 'y', 'of', 'line', 'title'), ('x', 'y')),
                ('limits', self.limits, ('of', 'error', 'below'), ('of', 'error', 'below'))):
            if entries is None:
                continue
            for entry in listed(where, entries):
                expect_keys(where, entry, keys)
                for key in needed:
                    if key not in entry:
                        raise StudyError(f'{where}: needs {key}')
                for key in set(entry) & {'x', 'y', 'of', 'error'}:
                    if not isinstance(entry[key], str) or entry[key] not in {*axes, 'outcome'}:
                        raise StudyError(f'{where}.{key}: there is no {shown(entry[key])}; there are '
                                         + ', '.join(sorted(axes)))
                for key in set(entry) & {'below', 'line'}:
                    entry[key] = number(f'{where}.{key}', entry[key])

    # ---- the grid

    def count(self):
        drawn = [len(each.values) for each in self.parameters if each.draw]
        return (len(self.scenes) * math.prod(len(each.values) for each in self.parameters if not each.draw)
                * (drawn[0] if drawn else 1)
                * sum(len(steps) * len(tolerances) for _, steps, tolerances in self.settings()))

    def settings(self):
        """(method, its ticks, its tolerances)."""
        return [(each, each.time_steps or self.time_steps, each.tolerances or self.tolerances)
                for each in self.methods]

    def points(self):
        """(scene, values by parameter) in their order."""
        grid = [each for each in self.parameters if not each.draw]
        drawn = [each for each in self.parameters if each.draw]
        draws = list(zip(*(each.values for each in drawn))) if drawn else [()]
        for scene in self.scenes:
            for values in itertools.product(*(each.values for each in grid)):
                for draw in draws:
                    chosen = {**dict(zip((each.name for each in grid), values)),
                              **dict(zip((each.name for each in drawn), draw))}
                    yield scene, {each.name: chosen[each.name] for each in self.parameters}

    def cases_at(self, first, scene, values):
        choices = itertools.chain.from_iterable(
            itertools.product([each], steps, tolerances) for each, steps, tolerances in self.settings())
        for offset, choice in enumerate(choices):
            yield Case(first + offset, scene, values, *choice)

    def text_of(self, case, overrides=None):
        """The scene of a case, as the runner would be given it. Throws StudyError."""
        template = self.scenes[case.scene]
        edits, factors = {}, set()
        for each in self.parameters:
            for path in each.paths:
                self.set(edits, path, case.values[each.name], f'parameters.{each.name}')
                factors |= {path} if each.is_factor else set()
        choices = dict(case.method.options)
        if case.time_step is not None:
            self.choose(choices, 'time_step', case.time_step, 'time_steps')
        if case.tolerance is not None:
            self.choose(choices, 'tolerance', case.tolerance, 'tolerances')
        choices.update(overrides or {})
        for key, value in choices.items():
            self.set(edits, f'world.{key}', value, 'methods, time_steps and tolerances',
                     replaces=overrides is not None)
        try:
            filled = []
            for path, value in edits.items():
                places = self.places(case.scene, path)
                filled += template.multiplied(path, places, value) if path in factors else [(places, value)]
            return template.filled(filled)
        except PathError as error:
            raise StudyError(f'{template.source}: {error}') from None

    @staticmethod
    def choose(choices, key, value, where):
        if key in choices:
            raise StudyError(f'{where}: a method has its own {key}')
        choices[key] = value

    @staticmethod
    def set(edits, path, value, where, replaces=False):
        if path in edits and not replaces:
            raise StudyError(f'{where}: {path} is set twice')
        edits[path] = value

    def places(self, scene, path):
        cache = self.__dict__.setdefault('_places', {})
        if (scene, path) not in cache:
            cache[scene, path] = self.scenes[scene].places(path)
        return cache[scene, path]

    # ---- jobs

    def jobs(self, program, progress=lambda count: None):
        """Groups of cases that are compared with each other, without their texts (`filled`); checks
        each case on the way."""
        self.check_overlaps()
        index = self.first
        for scene, values in self.points():
            cases = list(self.cases_at(index, scene, values))
            index += len(cases)
            checked = [self.checked(case) for case in cases]
            job = {'reference': self.reference_of(cases[0], checked), 'rounds': self.rounds,
                   'time_limit': self.time_limit}
            facts = json.dumps([self.fingerprint(job['reference']), self.rounds, self.time_limit,
                                self.memory, program], sort_keys=True)
            for entry in checked:
                entry['key'] = hashlib.sha256(
                    (facts + json.dumps(entry, sort_keys=True)).encode()).hexdigest()[:32]
            for entry, case in zip(checked, cases):
                entry.update(text=None, case=case)
            for entry in (job['reference'] or {}).get('runs', ()):
                entry['text'] = None
            job['cases'] = checked
            progress(len(cases))
            yield job, cases

    def filled(self, job):
        """A job as a worker needs it: texts are made when they are sent, for there may be many."""
        cases = [{**{key: value for key, value in entry.items() if key != 'case'},
                  'text': self.text_of(entry['case'])} for entry in job['cases']]
        reference = job['reference']
        if reference is not None and 'runs' in reference:
            plain = self.plain(job['cases'][0]['case'])
            reference = {'runs': [{**entry, 'text': self.text_of(plain, entry['options'])}
                                  for entry in reference['runs']]}
        return {**job, 'cases': cases, 'reference': reference}

    @staticmethod
    def plain(case):
        """Returns the case with its scene and parameters as they were written, without a method."""
        return case._replace(method=Method('reference', {}), time_step=None, tolerance=None)

    def check_overlaps(self):
        """No two parameters in one place."""
        for scene in self.scenes:
            seen = {}
            for each in self.parameters:
                for path in each.paths:
                    try:
                        places = self.places(scene, path)
                    except PathError as error:
                        raise StudyError(f'parameters.{each.name}: {self.scenes[scene].source}: '
                                         f'{error}') from None
                    for start, end, before, _ in places:
                        other = seen.setdefault((start, end, before), each.name)
                        if other != each.name:
                            raise StudyError(f'parameters.{each.name}: sets {path}, as {other} does')

    @staticmethod
    def fingerprint(reference):
        if reference is None or 'states' not in reference:
            return reference
        return hashlib.sha256(reference['times'].tobytes() + reference['states'].tobytes()).hexdigest()

    def described(self, case):
        values = {**case.values, 'method': case.method.name, 'time_step': case.time_step,
                  'tolerance': case.tolerance}
        return ', '.join(f'{key} {value}' for key, value in values.items() if value is not None)

    def checked(self, case):
        """Returns the data that a worker needs. Loads the scene, so that an invalid one is reported before the run."""
        text = self.text_of(case)
        try:
            world = engine.load_scene(text, self.scenes[case.scene].source)
        except ValueError as error:
            raise StudyError(f'{error}\n  with {self.described(case)}') from None
        entry = self.entry(text, world, self.described(case))
        if case.method.peer is not None:
            entry['peer'] = {**self.peer_of[case.method.name]._asdict(),
                             'tick': world.options['time_step'],
                             'sample': self.duration if self.every is None else self.every}
        return entry

    def entry(self, text, world, description):
        names, step = world.body_names, world.options['time_step']
        bodies = names if self.bodies is None else [str(name) for name in listed('outputs.bodies', self.bodies)]
        for name in bodies:
            if name not in names:
                raise StudyError(f'outputs.bodies: there is no {name!r}; there are ' + ', '.join(names))
        for name in (self.reference or {}).get('closed_form', {}):
            if name not in bodies:
                raise StudyError(f'reference.closed_form: there is no body {name!r} among the outputs')
        interval = self.duration if self.every is None else self.every
        if not max(self.duration / step, interval / step, step / interval) < MOST_TICKS:
            raise StudyError(f'duration: {self.duration:g} s and outputs.every: {interval:g} s are too far from '
                             f'a tick of {step:.17g} s ({description})')
        ticks = round(self.duration / step)
        if ticks < 1 or abs(ticks * step - self.duration) > 1e-9 * self.duration:
            raise StudyError(f'duration: {self.duration:g} s is not a whole number of ticks of '
                             f'{step:.17g} s ({description})')
        stride = max(1, round(interval / step))
        ratio = interval / step if interval >= step else step / interval
        if abs(ratio - round(ratio)) > 1e-6:
            raise StudyError(f'outputs.every: {interval:g} s and ticks of {step:.17g} s do not fit: one '
                             f'must be a multiple of the other ({description})')
        return {'text': text, 'duration': self.duration, 'stride': stride, 'bodies': bodies,
                'states': bodies if self.bodies is not None or len(bodies) <= 20 else [],
                'keeps_samples': self.keeps_samples}

    def reference_of(self, case, checked):
        if self.reference is None:
            return None
        kind, value = next(iter(self.reference.items()))
        if kind == 'closed_form':
            variables = {key: element for key, element in case.values.items()
                         if isinstance(element, (int, float))}
            return {'closed_form': {'bodies': value, 'variables': variables}}
        if kind == 'csv':
            times = sorted(value)
            for name in checked[0]['bodies']:
                if any(name not in value[time] for time in times):
                    raise StudyError(f'reference.csv: has no body {name!r} at each time')
            return {'times': np.array(times), 'states': np.array(
                [[value[time][name] for name in checked[0]['bodies']] for time in times])}
        plain = self.plain(case)
        steps = [step for _, steps, _ in self.settings() for step in steps if step is not None]
        step = min(steps) if steps else engine.load_scene(self.text_of(plain)).options['time_step']
        runs = []
        for is_looser in (False, True):  # by how much they differ is what the first is off by, at most
            # shorter ticks than any case: where one substep a tick is enough, a tolerance changes nothing
            options = {'time_step': min(step, self.every or step) / 2.0, **value}
            if is_looser and 'tolerance' in options:
                options['tolerance'] *= 10.0
            options['time_step'] *= 2.0 if is_looser else 1.0
            text = self.text_of(plain, options)
            try:
                world = engine.load_scene(text, f'{self.scenes[case.scene].source}, the reference')
            except ValueError as error:
                raise StudyError(f'reference.run: {error}') from None
            runs.append({**self.entry(text, world, 'the reference'), 'options': options})
        return {'runs': runs}


def expect_any(where, value):
    if not isinstance(value, dict):
        raise StudyError(f'{where}: must be a map, got {shown(value)}')
    return value


def load(path, known_peers=None):
    path = pathlib.Path(path)
    try:
        text = read_text(path)
    except (OSError, ValueError) as error:
        raise StudyError(f'cannot read {path}: {error}') from None
    return Study(text, path.parent, str(path), known_peers)
