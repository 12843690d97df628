"""From the rows of the CSV files to what the report says: no plots, no pages."""
import collections
import math
import statistics

MEASURES = {'position': 'position [m]', 'orientation': 'orientation [rad]',
            'energy': 'energy [1]', 'momentum': 'momentum [1]', 'constraint': 'constraints [m]',
            'penetration': 'penetration [m]'}
TARGETS = (1e-2, 1e-4, 1e-6, 1e-9)
OURS = 'constraint_sim'
# from good to bad, with the colours of the grid
CLASSES = {'exact': '#1a7f37', 'stable': '#9fd89f', 'drifting': '#ffe08a', 'stretched': '#ff9d5c',
           'refused': '#b39ddb', 'too slow': '#c8c8c8', 'crashed': '#6b1d5c', 'exploded': '#d7263d',
           'n/a': '#f4f4f4'}

Run = collections.namedtuple('Run', 'value outcome time spread memory errors')


def number(text):
    return float(text)


def judged(errors):
    """Returns the error by which a run is judged: the larger of position [m] and orientation [rad], or, without a
    reference, the largest of the errors of joints, penetration and energy."""
    for names in (('position', 'orientation'), ('constraint', 'penetration', 'energy')):
        known = [errors[name] for name in names if not math.isnan(errors[name])]
        if known:
            return max(known)
    return math.nan


def is_ours(contestant):
    return contestant.split()[0] == OURS


def runs_of(rows):
    """problem -> contestant -> runs, each the best time of its rounds, or that of the part that was
    run where there was no time for all."""
    gathered = collections.defaultdict(list)
    for row in rows:
        gathered[row['problem'], row['contestant'], float(row['value'])].append(row)
    found = collections.defaultdict(lambda: collections.defaultdict(list))
    for (problem, contestant, value), same in sorted(gathered.items(), key=lambda item: -item[0][2]):
        times = [number(row['run_time']) for row in same if row['outcome'] == 'ok']
        first = min(same, key=lambda row: int(row['round']))
        errors = {name: number(first[name]) for name in MEASURES}
        best = min(times) if times else number(first['run_time'])
        spread = statistics.median(times) / best - 1.0 if len(times) > 1 else math.nan
        found[problem][contestant].append(
            Run(value, first['outcome'], best, spread, number(first['memory']), errors))
    return found


def contenders(rows, noise=math.inf):
    """(problem, contestant) -> values of the runs that are worth repeating: those that succeeded, without those that
    another run of the same engine beats in error, and in run time by more than the factor `noise`."""
    found = collections.defaultdict(list)
    for problem, contestants in runs_of(rows).items():
        points = collections.defaultdict(list)
        for contestant, runs in contestants.items():
            if not contestant.endswith(' perturbed'):
                points[contestant.split()[0]] += [(run.time, judged(run.errors), contestant, run.value)
                                                  for run in runs if run.outcome == 'ok']
        for same in points.values():
            for time, error, contestant, value in same:
                if not any(other[0] * noise < time and other[1] <= error for other in same):
                    found[problem, contestant].append(value)
    return found


def time_to(runs, target):
    """Least run time of those that reach the target, and with which value; None: none does."""
    good = [run for run in runs if run.outcome == 'ok' and judged(run.errors) <= target]
    return min(good, key=lambda run: run.time) if good else None


def best_of(contestants, target, condition):
    """(contestant, run) with the least run time to the target, or None."""
    found = [(name, time_to(runs, target)) for name, runs in contestants.items() if condition(name)]
    found = [(name, run) for name, run in found if run]
    return min(found, key=lambda pair: pair[1].time) if found else None


def comparison(runs):
    """(problem, target, best of ours, best peer, ratio of run times); ratio > 1: we win."""
    lines = []
    for problem, contestants in sorted(runs.items()):
        for target in TARGETS:
            ours = best_of(contestants, target,
                           lambda name: is_ours(name) and not name.endswith(' perturbed'))
            peer = best_of(contestants, target, lambda name: not is_ours(name))
            ratio = peer[1].time / ours[1].time if ours and peer else math.nan
            lines.append((problem, target, ours, peer, ratio))
    return lines


def pareto(points):
    """Returns the (time, error) points that no other point beats in both, fastest first."""
    front = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def spread(runs):
    """Median and largest excess of the median time over the best of the rounds."""
    all_spreads = [run.spread for contestants in runs.values() for same in contestants.values()
                   for run in same if not math.isnan(run.spread)]
    if not all_spreads:
        return math.nan, math.nan
    return statistics.median(all_spreads), max(all_spreads)


def verdict(row, problem):
    """Class of a cell of the stability grid, and its worst figure, relative to the scene's size."""
    outcome = row['outcome']
    if outcome == 'unsupported':
        return 'n/a', math.nan
    if problem.invalid:
        return ('exact', 0.0) if outcome == 'refused' else ('exploded', math.inf)
    if outcome in ('refused', 'crashed'):
        return outcome, math.nan
    if outcome in ('hung', 'too_slow'):
        return 'too slow', math.nan
    errors = {name: number(row[name]) for name in MEASURES}
    position = errors['position'] / problem.length
    if not math.isnan(errors['orientation']):
        position = max(position, errors['orientation'])
    constraint = 0.0 if problem.conflict or math.isnan(errors['constraint']) \
        else errors['constraint'] / problem.length
    energy = 0.0 if math.isnan(errors['energy']) else errors['energy']
    known = not math.isnan(errors['position'])
    worst = position if known else max(constraint, energy)
    if outcome == 'not_finite':
        return 'exploded', math.inf
    far = position if known else number(row['distance']) / problem.length
    if far > 10.0 or energy > 10.0:
        return 'exploded', max(far, energy)
    if known and position <= 1e-6:
        return 'exact', worst
    if constraint > 1e-2:
        return 'stretched', max(worst, constraint)
    if energy > 1e-2:
        return 'drifting', max(worst, energy)
    return 'stable', worst


def verdicts(rows, problems):
    """problem -> contestant -> [(tick, class, figure)], from the longest tick on."""
    found = collections.defaultdict(lambda: collections.defaultdict(list))
    for row in rows:
        found[row['problem']][row['contestant']].append(
            (number(row['value']), *verdict(row, problems[row['problem']])))
    for contestants in found.values():
        for cells in contestants.values():
            cells.sort(key=lambda cell: -cell[0])
    return found


def counts(grid):
    """contestant -> class -> number of cells."""
    found = collections.defaultdict(collections.Counter)
    for contestants in grid.values():
        for contestant, cells in contestants.items():
            found[contestant].update(kind for _, kind, _ in cells)
    return found


def slope(sizes, values):
    """Exponent of the growth, by least squares of the logarithms."""
    x, y = [math.log(size) for size in sizes], [math.log(value) for value in values]
    mean_x, mean_y = statistics.mean(x), statistics.mean(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y)) / \
        sum((a - mean_x) ** 2 for a in x)


def scaling(runs, instructions):
    """Rows of scaling.csv from runs of problems KIND_COUNT, whose one setting is a tick."""
    rows = []
    for problem, contestants in runs.items():
        kind, count = problem.rsplit('_', 1)
        for contestant, (run,) in contestants.items():
            counted = instructions.get(f'{contestant} {problem}', math.nan)
            is_done = run.outcome in ('ok', 'too_slow')
            rows.append({'kind': kind, 'count': int(count), 'contestant': contestant,
                         'outcome': run.outcome,
                         'time': run.time * run.value if is_done else math.nan,
                         'bytes': run.memory, 'instructions': counted})
    return sorted(rows, key=lambda row: (row['kind'], not is_ours(row['contestant']),
                                         row['contestant'], row['count']))


def growth(rows, measure):
    """(kind, contestant) -> [(count, value)], of what was measured."""
    lines = collections.defaultdict(list)
    for row in rows:
        if row[measure] > 0.0:
            lines[row['kind'], row['contestant']].append((row['count'], row[measure]))
    return lines
