"""The figures of the page: compressed tables in FOLDER/data, from which the page follows to the byte.

They are a small part of what is measured: of each problem and engine the runs that no other run of this engine
beats in error and run time, and of the stability grid the class of each run.
"""
import collections
import csv
import io
import json
import lzma
import math

import package_path  # noqa: F401
from constraint_sim.sweep import figures

import kinds

EACH = 'each contestant'
MANY = ('run_time', 'position', 'orientation', 'constraint', 'energy')
COLUMNS = {
    'fronts': {
        'problem': 'the scene, a name of bench/report/problems',
        'contestant': 'the engine and the way it is used',
        'value': 'time step [s], or tolerance in the terms of the engine',
        'run_time': 'run time over simulated time, best of the rounds [µs/s]',
        'error': 'largest error of a position [m] or orientation [rad]; of scenes without a reference the worst of '
                 'joints [m], penetration [m] and energy [1]'},
    'stability': {
        'problem': 'the case', 'value': 'time step [s]',
        EACH: 'class of its run, as defined in grid.html, which scripts/report makes'},
    'many': {
        'problem': 'the scene', 'contestant': 'the engine and the way it is used', 'outcome': 'of the run',
        'run_time': 'run time over simulated time [µs/s]', 'position': 'largest error [m]',
        'orientation': 'largest error [rad]', 'constraint': 'largest error of a joint [m]',
        'energy': 'largest change over the largest kinetic energy [1]'},
    'sizes': {
        'kind': 'links of a chain, free bodies, or balls in contact with a plane',
        'count': 'how many', 'contestant': 'the engine and the way it is used, with its own tolerances',
        'outcome': 'after one that is not `ok` no larger scene was tried',
        'time': 'run time of a step of 1 ms [µs]', 'bytes': 'resident memory of the scene and its first steps',
        'instructions': 'of a step, counted by valgrind; nan: not counted'},
    'problems': {
        'problem': 'the scene', 'kind': 'the part of the page; empty in the stability grid',
        'source': 'where the motion is known from; empty: no reference',
        'own_error': 'error of the reference: difference to steps half as long [m]; 0 for closed forms'}}

# `runs`: one dictionary for each run of scripts/report that the figures come from
Stored = collections.namedtuple('Stored', 'runs fronts stability many sizes problems')


def brief(value):
    return value if isinstance(value, (str, int)) else f'{value:.4g}'


def fronts_of(runs):
    """Returns the rows of fronts.csv from figures.runs_of()."""
    rows = []
    for problem, contestants in sorted(runs.items()):
        points = collections.defaultdict(list)
        for contestant, found in contestants.items():
            if contestant.endswith(' perturbed'):
                continue
            points[contestant.split()[0]] += [
                (run.time, figures.judged(run.errors), contestant, run.value) for run in found
                if run.outcome == 'ok' and not math.isnan(figures.judged(run.errors))]
        for engine in sorted(points):
            least = math.inf
            for time, error, contestant, value in sorted(points[engine]):
                if error < least:
                    least = error
                    rows.append({'problem': problem, 'contestant': contestant, 'value': f'{value:.6g}',
                                 'run_time': f'{time:.4g}', 'error': f'{error:.3g}'})
    return rows


def stability_of(grid):
    """Returns the rows of stability.csv from figures.verdicts(): a column for each contestant."""
    rows = collections.defaultdict(dict)
    for problem, contestants in sorted(grid.items()):
        for contestant, cells in sorted(contestants.items()):
            for step, kind, _ in cells:
                rows[problem, f'{step:.4g}'][contestant] = kind
    return [{'problem': problem, 'value': value, **classes} for (problem, value), classes in rows.items()]


def many_of(runs):
    """Returns the rows of many.csv from figures.runs_of()."""
    return [{'problem': problem, 'contestant': contestant, 'outcome': run.outcome, 'run_time': run.time,
             **{name: run.errors[name] for name in MANY[1:]}}
            for problem, contestants in sorted(runs.items()) for contestant, (run,) in sorted(contestants.items())]


def problems_of(problems, own_errors, shown):
    """Returns the rows of problems.csv: graded problems with figures, and cases of the grid."""
    return [{'problem': each.name, 'kind': kinds.kind_of(each.name, each.group) if each.graded else '',
             'source': each.source, 'own_error': f'{own_errors.get(each.name, math.nan):.2g}'}
            for each in sorted(problems.values()) if each.name in shown]


def write_table(path, rows, columns):
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator='\n')
    writer.writeheader()
    writer.writerows({name: brief(row.get(name, '')) for name in columns} for row in rows)
    path.write_bytes(lzma.compress(text.getvalue().encode(), preset=9 | lzma.PRESET_EXTREME))


def read_table(path):
    return list(csv.DictReader(io.StringIO(lzma.decompress(path.read_bytes()).decode())))


def write(folder, stored):
    folder.mkdir(parents=True, exist_ok=True)
    for name, described in COLUMNS.items():
        rows = getattr(stored, name)
        columns = [column for column in described if column != EACH]
        if EACH in described:
            columns += sorted({column for row in rows for column in row} - set(columns))
        write_table(folder / f'{name}.csv.xz', rows, columns)
    (folder / 'runs.json').write_text(json.dumps(stored.runs, indent=1, ensure_ascii=False) + '\n')


def read(folder):
    return Stored(json.loads((folder / 'runs.json').read_text()),
                  *(read_table(folder / f'{name}.csv.xz') for name in COLUMNS))


def runs_of(rows):
    """problem -> contestant -> runs of the fronts, as figures.runs_of() returns them."""
    none = dict.fromkeys(figures.MEASURES, math.nan)
    found = collections.defaultdict(lambda: collections.defaultdict(list))
    for row in rows:
        found[row['problem']][row['contestant']].append(figures.Run(
            float(row['value']), 'ok', float(row['run_time']), math.nan, math.nan,
            {**none, 'position': float(row['error'])}))
    return found


def counts_of(rows):
    """contestant -> class -> number of runs of the stability grid."""
    found = collections.defaultdict(collections.Counter)
    for row in rows:
        for contestant, kind in row.items():
            if contestant not in ('problem', 'value') and kind:
                found[contestant][kind] += 1
    return found


def sizes_of(rows):
    return [{**row, **{name: float(row[name]) for name in ('time', 'bytes', 'instructions')},
             'count': int(row['count'])} for row in rows]
