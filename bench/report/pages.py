"""Writes the page of the report (summary.md with at most ten pictures) from the stored figures, and index.html,
which has the same page and all that is measured: a diagram for each problem, all contestants, the stability grid."""
import csv
import html
import math
import statistics

import package_path  # noqa: F401
from constraint_sim.sweep import figures, plots
from constraint_sim.sweep.report_pages import (
    AIM, CONTESTANT_HEADER, FRONT_TEXT, HEADER, JUDGED_BY, brief, comparison_lines, contestant_lines, exploded_of,
    grid_body, markdown_table, page, table)

import cells
import kinds
import pictures
import published
import stored as stored_figures
from document import (Folded, Heading, Items, Numbered, Picture, Table, Text, write_html, write_markdown)

TITLE = 'Error against run time beside other engines'
DEFAULT = f'{figures.OURS} auto'
NAMES = pictures.NAMES
PICTURES = ('scenes', 'ratios', *(kind.name for kind in kinds.KINDS), 'stability', 'sizes')
SHOWN_TARGETS = (1e-2, 1e-4, 1e-6)
REFERENCE_COLUMNS = {
    'problem': 'the scene', 'source': 'where its motion is known from',
    'own_error': 'largest difference of a position, or of an orientation times the size of the scene, '
                 'to the same with steps half as long [m]; 0 for closed forms'}
SCALING_COLUMNS = {
    'kind': 'what there is ever more of: links of a chain, free bodies, balls in contact with a plane',
    'count': 'how many',
    'contestant': 'the engine and the way it is used, with tolerances of its own',
    'outcome': 'as in cells.csv; after one that is not `ok` no larger scene was tried',
    'time': 'run time of a tick of 1 ms, best of the rounds; an error-controlled engine may take '
            'several steps in it [µs]',
    'bytes': 'resident memory that building the scene and its first ticks took',
    'instructions': 'of a tick, counted by valgrind; nan: not counted'}

# ---- the first page

def small(error):
    """Returns a power of ten as text: 1e-2, not 0.01."""
    return f'1e{round(math.log10(error))}'


def named(engines):
    names = [NAMES.get(engine, engine) for engine in engines]
    return ', '.join(names[:-1]) + f' and {names[-1]}' if len(names) > 1 else ''.join(names)


def compared(lines, target):
    """Returns the lines of a target that both sides reach."""
    return [line for line in lines if line[1] == target and not math.isnan(line[4])]


def only_one(lines, target):
    """Returns (number of problems that ours alone reaches, that another engine alone reaches)."""
    own = [line for line in lines if line[1] == target]
    return sum(1 for line in own if line[2] and not line[3]), sum(1 for line in own if line[3] and not line[2])


def speed_line(lines, target, note):
    both = compared(lines, target)
    alone, behind = only_one(lines, target)
    if not both:
        return f'**Error {small(target)}** ({note}): no problem that both reach.'
    won = sum(1 for line in both if line[4] > 1.0)
    tenfold = sum(1 for line in both if line[4] >= AIM)
    return (f'**Error {small(target)}** ({note}): constraint_sim is faster in {won} of {len(both)} problems that both '
            f'reach, at least {AIM:g} times in {tenfold}; median ratio '
            f'{statistics.median(line[4] for line in both):.2g}. It alone reaches {alone} more, another engine alone '
            f'{behind}.')


def stability_line(counts, cases):
    """Returns a sentence on runs that exploded, of the default method and of the steadiest other contestant."""
    if DEFAULT not in counts:
        return '**Stability** was not measured.'
    run = {name: sum(found.values()) - found['n/a'] for name, found in counts.items()}
    def exploded(name):
        return f'{counts[name]["exploded"]} of {run[name]}'
    peers = [name for name in counts if not figures.is_ours(name)]
    # a contestant that cannot express most cases says little
    fair = [name for name in peers if run[name] >= 0.9 * max(run[peer] for peer in peers)]
    text = (f'**Stability** ({cases} extreme scenes, such as mass ratios up to 1e9): the default method explodes in '
            f'{exploded(DEFAULT)} runs')
    if fair:
        best = min(fair, key=lambda name: (counts[name]['exploded'] / run[name], name))
        text += f'; of other engines the steadiest that runs most scenes, {best}, in {exploded(best)}'
    return text + '.'


def many_line(sizes):
    """Returns a sentence on the cost of a step with many links, bodies and contacts."""
    parts = []
    for kind in sorted({row['kind'] for row in sizes}):
        own = [row for row in sizes if row['kind'] == kind and row['time'] > 0.0]
        ours = {row['count'] for row in own if figures.is_ours(row['contestant'])}
        both = ours & {row['count'] for row in own if not figures.is_ours(row['contestant'])}
        if not both:
            continue
        count = max(both)
        best = {}
        for row in own:
            if row['count'] == count:
                side = figures.is_ours(row['contestant'])
                best[side] = min(best.get(side, row), row, key=lambda each: each['time'])
        peer = best[False]['contestant'].split()[0]
        parts.append(f'{count} {kind} {brief(best[True]["time"] / 1e3)} ms ({NAMES.get(peer, peer)} '
                     f'{brief(best[False]["time"] / 1e3)} ms)')
    if not parts:
        return '**Many bodies** were not measured beside another engine.'
    return '**Many bodies**: a step of 1 ms, by the fastest method of an engine, takes with ' + ', '.join(parts) + '.'


def loss_line(lines):
    lost = [line for line in lines if line[4] < 1.0 and line[1] in SHOWN_TARGETS]
    both = [line for line in lines if not math.isnan(line[4]) and line[1] in SHOWN_TARGETS]
    at = ', '.join(f'{sum(1 for line in lost if line[1] == target)} at {small(target)}' for target in SHOWN_TARGETS)
    return (f'**Losses**: another engine is faster in {len(lost)} of {len(both)} cases ({at}). '
            'Where and why is [below](#where-other-engines-are-faster).')


def measured_line(runs):
    minutes = sum(run['minutes'] for run in runs)
    if len(runs) == 1:
        run, = runs
        return (f'Measured at commit {run["commit"]} ({run["date"]}) in {minutes:.0f} minutes on {run["processor"]}. '
                '`./scripts/report` repeats all of it, `./scripts/report --quick` a tenth.')
    return ('Measured at several commits, ' + ', '.join(f'{run["commit"]} ({run["covers"]})' for run in runs) +
            f', in {minutes:.0f} minutes on {runs[0]["processor"]}. `./scripts/report` measures all of it at one '
            'commit, `./scripts/report --quick` a tenth.')


def ten_lines(stored, lines, counts, sizes):
    engines = sorted({engine for run in stored.runs for engine in run['engines']}, key=list(NAMES).index)
    longest = max(run['time_steps'][0] for run in stored.runs)
    shortest = min(run['time_steps'][1] for run in stored.runs)
    problems = {line[0] for line in lines}
    known = sum(1 for row in stored.problems if row['problem'] in problems and row['source'])
    others = f', {named(engines)}' if engines else ''
    return [
        f'**Question**: how much run time does an engine need for a given error? {len(problems)} scenes; the exact '
        f'motion of {known} is known, from formulas or from independent integration in long double.',
        f'**Engines**: constraint_sim{others}. Each runs what it can express, with all its methods, and with time '
        f'steps from {longest:g} s to {shortest:g} s or tolerances. The fastest run below an error counts.',
        '**Ratio**: run time of the best other engine / run time of constraint_sim. 10: constraint_sim is ten times '
        'faster. Below 1: the other engine is faster.',
        speed_line(lines, 1e-2, 'm or rad; enough for a game'),
        speed_line(lines, 1e-4, 'enough for most robots'), speed_line(lines, 1e-6, 'for analysis'),
        stability_line(counts, len({row['problem'] for row in stored.stability})),
        many_line(sizes), loss_line(lines), measured_line(stored.runs)]


KIND_HEADER = ['kind', 'scenes', *(f'error {small(target)}' for target in SHOWN_TARGETS)]
KIND_TEXT = ('In a cell: problems in which constraint_sim is faster, of those that both reach, and the median ratio; '
             '+ those that constraint_sim alone reaches, − those that another engine alone reaches.')


def kind_lines(lines, kind_of):
    found = []
    for kind in kinds.KINDS:
        own = [line for line in lines if kind_of[line[0]] == kind.name]
        if not own:
            continue
        texts = []
        for target in SHOWN_TARGETS:
            both = compared(own, target)
            alone, behind = only_one(own, target)
            text = f'{sum(1 for line in both if line[4] > 1.0)} of {len(both)}'
            text += f', {statistics.median(line[4] for line in both):.2g}' if both else ''
            texts.append(text + (f', +{alone}' if alone else '') + (f', −{behind}' if behind else ''))
        found.append([kind.title, str(len({line[0] for line in own})), *texts])
    return found


LOSS_HEADER = ['kind', 'problems, with the ratio at each error', 'faster', 'why']


def loss_lines(lines, kind_of):
    """Returns a line for each kind and reason, with the problems that another engine wins."""
    found = {}
    for problem, target, ours, peer, ratio in lines:
        if ratio < 1.0 or (peer and not ours):
            kind = kind_of[problem]
            cell = found.setdefault((kind, kinds.reason_of(problem, kind)), {}).setdefault(problem, ([], set()))
            cell[0].append(f'{ratio:.2g} at {small(target)}' if ours else f'not reached at {small(target)}')
            cell[1].add(peer[0].split()[0])
    titles = {kind.name: kind.title for kind in kinds.KINDS}
    order = [kind.name for kind in kinds.KINDS]
    return [[titles[kind],
             '; '.join(f'{problem}: {", ".join(ratios)}' for problem, (ratios, _) in sorted(cells_of.items())),
             named(sorted({engine for _, engines in cells_of.values() for engine in engines}, key=list(NAMES).index)),
             reason or 'not known']
            for (kind, reason), cells_of in sorted(found.items(), key=lambda item: order.index(item[0][0]))]


RATIO_HEADER = ['problem', 'kind', *(f'error {small(target)}' for target in figures.TARGETS)]
RATIO_TEXT = ('In a cell: ratio (run time of constraint_sim / of the best other engine [µs per simulated second]). '
              'Bold: the other engine is faster. –: not reached within the time limit.')


def ratio_lines(lines, kind_of):
    rows = {}
    for problem, _, ours, peer, ratio in lines:
        text = '–'
        if ours or peer:
            value = '' if math.isnan(ratio) else f'**{ratio:.2g}** ' if ratio < 1.0 else f'{ratio:.2g} '
            peer_name = peer[0].split()[0] if peer else ''
            text = f'{value}({brief(ours and ours[1].time)} / {brief(peer and peer[1].time)} {peer_name})'.replace(
                ' )', ')')
        rows.setdefault(problem, []).append(text)
    titles = {kind.name: kind.title for kind in kinds.KINDS}
    order = list(titles)
    return [[problem, titles[kind_of[problem]], *texts] for problem, texts in sorted(
        rows.items(), key=lambda item: (order.index(kind_of[item[0]]), item[0]))]


def count_lines(counts):
    names = sorted(counts, key=lambda name: (not figures.is_ours(name), name))
    shown = [kind for kind in figures.CLASSES if any(counts[name][kind] for name in names)]
    return ['contestant', *shown], [[name, *(str(counts[name][kind]) for kind in shown)] for name in names]


def conditions_of(run):
    """Returns the conditions of a run: programs, machine and duration."""
    budgets = run['budgets']
    median, worst = run['spread']
    spread = f'; the median of the rounds is above it by {100 * median:.0f} % (median of all settings), at most ' \
        f'{100 * worst:.0f} %' if median is not None else ', too few to tell how far they lie apart'
    return [
        f'commit: {run["commit"]} ({run["date"]})' + (f', for {run["covers"]}' if run['covers'] else ''),
        f'processor: {run["processor"]}', f'system: {run["system"]}', f'compiler: {run["compiler"]}',
        'engines: ' + ', '.join(f'{NAMES.get(name, name)} {version}'
                                for name, version in sorted(run['engines'].items())) + '; absent: ' + (', '.join(run['absent']) or 'none'),
        f'{run["size"]} run, measured in {run["minutes"]:.1f} minutes; each time the best of {run["rounds"]} '
        'interleaved rounds' + spread + '; runs that another of their engine beats in error, and in run time by the '
        f'factor {run["noise"]:g}, were not repeated',
        f'time steps from {run["time_steps"][0]:g} s to {run["time_steps"][1]:g} s; longest run ' +
        ', '.join(f'{limit:g} s ({part})' for part, limit in budgets.items())]


def first_page(stored, has):
    """Returns the blocks of the page. `has` tells whether a picture exists."""
    runs = stored_figures.runs_of(stored.fronts)
    lines = figures.comparison(runs)
    kind_of = {row['problem']: row['kind'] for row in stored.problems}
    counts, sizes = stored_figures.counts_of(stored.stability), stored_figures.sizes_of(stored.sizes)

    def picture(name, alt):
        return [Picture(f'{name}.svg', alt)] if has(name) else []

    blocks = [Numbered(ten_lines(stored, lines, counts, sizes)),
              *picture('ratios', 'ratios of run times, by kind of problem'),
              Table(KIND_HEADER, kind_lines(lines, kind_of)), Text(KIND_TEXT),
              Heading('Where other engines are faster'), Table(LOSS_HEADER, loss_lines(lines, kind_of)),
              Heading('The scenes'),
              Text('Two of each kind, as they start. Blue: bodies; brown: rods; red: joints.'),
              *picture('scenes', 'scenes of each kind'), Heading('Error against run time'),
              Text('Further left is faster, further down more exact. A line is the best that an engine reaches with all '
                   'its methods and settings.')]
    for kind in kinds.KINDS:
        if has(kind.name):
            names = ', '.join(sorted(name for name in runs if kind_of[name] == kind.name))
            blocks += [Text(f'**{kind.title}.** {kind.text}'),
                       Picture(f'{kind.name}.svg', f'error against run time: {kind.title}'),
                       Folded('all problems of this kind', [Text(names)])]
    blocks += [Heading('Stability'),
               Text('Runs of extreme scenes at time steps from 0.5 s to 1 ms, by how they end. Exact: position error at '
                    'most 1e-6 of the size of the scene. Drifting: energy wrong by more than 1 %. Stretched: joints off '
                    'by more than 1 % of the size. Exploded: not finite, more than ten times the size away, or energy '
                    'above ten times its scale. Stable: none of these. Too slow: beyond the time limit. Not possible '
                    '(n/a): the engine or its adapter cannot express the scene.'),
               *picture('stability', 'share of runs that are exact, stable, or explode'),
               Folded('numbers of runs', [Table(*count_lines(counts))])] if counts else []
    if sizes:
        blocks += [Heading('Many bodies'),
                   Text('A step of 1 ms with ever more links of a chain, free bodies, and balls on a plane; of each '
                        'engine its fastest method.'),
                   *picture('sizes', 'run time of a step against the number of bodies')]
    if stored.many:
        blocks.append(Folded('scenes of 1000 to 10 000 bodies at steps of 1/240 s', [
            Text(MANY_TEXT), Table(MANY_HEADER, many_lines(stored.many))]))
    if sizes:
        blocks.append(Folded('how run time and memory grow', [
            Text(SLOPE_TEXT), Table(SLOPE_HEADER, slope_lines(sizes))]))
    return blocks + [
        Heading('Details'),
        Folded('all ratios', [Text(RATIO_TEXT), Table(RATIO_HEADER, ratio_lines(lines, kind_of))]),
        Folded('what this does not measure', [Items(HONESTY)]),
        Folded('conditions', [Text(JUDGED_BY), *(Items(conditions_of(run)) for run in stored.runs),
                              Text(own_error_text(stored.problems, runs))]),
        Text('`./scripts/report` writes the same page to `build/report/full/index.html`, with a diagram for each problem, '
             'all methods of all engines, the grid of stability and the raw figures. The figures of this page are in '
             '`data/*.csv.xz`, with [their columns](columns.md); `./scripts/report --redraw` makes the page of them.')]


def own_error_text(problems, runs):
    errors = [float(row['own_error']) for row in problems if row['problem'] in runs]
    largest = max((error for error in errors if not math.isnan(error)), default=0.0)
    return f'Largest error of a reference: {largest:.1g} m.'


# ---- parts that both pages have

def many_lines(rows):
    """Returns lines for each scene of many bodies, fastest first."""
    done = [row for row in rows if row['outcome'] != 'unsupported']
    done.sort(key=lambda row: (row['problem'], math.isnan(float(row['run_time'])), float(row['run_time'])))
    return [[row['problem'], row['contestant'], row['outcome'].replace('_', ' '), brief(float(row['run_time']) * 1e-6),
             *(brief(float(row[name])) for name in MANY_ERRORS)] for row in done]


MANY_ERRORS = ('position', 'orientation', 'constraint', 'energy')
MANY_HEADER = ['problem', 'contestant', 'outcome', 'run time per second [s/s]',
               *(figures.MEASURES[name] for name in MANY_ERRORS)]
MANY_TEXT = ('Steps of 1/240 s, with the default tolerances of each engine. '
             'A run that is too slow was stopped at the time limit; its figures are those until then. '
             'net_32 is a net of 1984 rods, and two rods that hold its corners.')


def slope_lines(sizes):
    """Returns for each kind and contestant the exponents of time, instructions and memory, and the cost of
    one more element at the largest size."""
    found = {measure: figures.growth(sizes, measure) for measure in ('time', 'instructions', 'bytes')}
    lines = []
    for kind, contestant in sorted(found['time'], key=lambda key: (
            key[0], not figures.is_ours(key[1]), key[1])):
        line, key = found['time'][kind, contestant], (kind, contestant)
        counts = [count for count, _ in line]
        def slope(measure):
            points = found[measure].get(key, [])
            return f'{figures.slope(*zip(*points)):.2f}' if len(points) > 1 else '–'
        weight = found['bytes'].get(key, [(1, math.nan)])[-1]
        lines.append([kind, contestant, f'{counts[0]} to {counts[-1]}', slope('time'),
                      brief(line[-1][1] / line[-1][0]), slope('instructions'), slope('bytes'),
                      brief(weight[1] / weight[0])])
    return lines


SLOPE_HEADER = ['kind', 'contestant', 'over', 'slope of time', 'µs for one, at most', 'of instructions',
                'of memory', 'bytes for one, at most']
SLOPE_TEXT = ('Run time of a step of 1 ms, and memory, from 10 links, bodies or contacts on, for each '
              'contestant as far as the time limit allows. A slope is the exponent of the growth. The cost of one link, '
              'body or contact is taken at the largest number.')


HONESTY = [
    'One thread of one machine; nothing is said of engines in parallel or on other processors.',
    'Errors are taken each 0.1 s (at longer time steps each step), of the states an engine reports; velocities '
    'enter only energy and momentum.',
    'Each engine is used as its documentation suggests, through one adapter written for this report; '
    'somebody who knows it better may get more out of it. Point masses have small inertias where an '
    'engine insists on one.',
    'Time steps are 0.2 s and divisors of 0.1 s, tolerances powers of ten with time steps of 0.2 s: a finer choice '
    'moves a run time by up to the factor between two of them.',
    'Runs beyond the budget were not made, so that "–" may mean too dear as well as never.',
    'Building a scene and rendering are not measured. Memory is resident memory, and of small scenes '
    'mostly what a library takes once.',
    'Scenes were chosen by the authors of constraint_sim. Those with contacts are few and simple.',
    'What an adapter cannot express is left out (outcome `unsupported`): MuJoCo has no restitution by '
    'a coefficient; Simbody (compliant contacts: Hertz, 1e8 Pa, 10 s/m) has no contact of boxes with '
    'anything but planes; DART and Simbody take other means of two coefficients of friction than the '
    'geometric one; DART has no rods, and where light bars (1e-6 to 1e-2 of the mass they hold) stood '
    'for rods in a four-bar linkage they flew apart at the ticks that were tried, so its loops are of '
    'ball joints; springs, motors and, of others than DART, loops are not built in joint coordinates.',
]


def columns_text(described):
    return '\n'.join(f'# Columns of {name}\n\n' + markdown_table(
        ['column', 'meaning'], [[f'`{column}`', text] for column, text in columns.items()])
        for name, columns in described)


def write(output, stored, scenes=None):
    """Writes summary.md, columns.md and their pictures. `scenes` gives (kind, problem, scene as YAML); without it
    an existing picture of scenes stays."""
    output.mkdir(parents=True, exist_ok=True)
    runs = stored_figures.runs_of(stored.fronts)
    lines = figures.comparison(runs)
    kind_of = {row['problem']: row['kind'] for row in stored.problems}
    counts = stored_figures.counts_of(stored.stability)
    drawn = {'scenes': (output / 'scenes.svg').exists()}
    if scenes:
        drawn['scenes'] = True
        pictures.scenes(scenes, output / 'scenes.svg')
    if lines:
        drawn['ratios'] = True
        pictures.ratios(lines, kind_of, output / 'ratios.svg')
    for kind in kinds.KINDS:
        drawn[kind.name] = pictures.fronts(runs, kind.shown, output / f'{kind.name}.svg')
    if counts:
        drawn['stability'] = True
        pictures.stability(counts, output / 'stability.svg')
    drawn['sizes'] = pictures.sizes(stored_figures.sizes_of(stored.sizes), output / 'sizes.svg')
    blocks = first_page(stored, lambda name: drawn.get(name, False))
    write_markdown(output / 'summary.md', TITLE, blocks)
    (output / 'columns.md').write_text(columns_text(
        (f'data/{name}.csv.xz', columns) for name, columns in stored_figures.COLUMNS.items()))
    return blocks


# ---- all that is measured

def published_lines(runs, problems, budget):
    """Returns each peer's time beside that of an earlier comparison, over the median ratio, with reasons
    for large deviations and for times in only one of both. Peers outside the budget here are skipped."""
    found = []
    for problem, columns in published.TIMES.items():
        if problem not in runs:
            continue
        for column, times in columns.items():
            same = {name: own for name, own in runs[problem].items()
                    if published.column(name) == column or
                    (column == 'simbody' and name.startswith('simbody'))}
            for target, then in zip(published.TARGETS, times):
                now = figures.best_of(same, target, lambda name: True)
                if same and (then or now):
                    found.append((problem, column, target, then, now and now[1].time))
    both = [now / then for *_, then, now in found if then and now]
    if not both:
        return [], math.nan
    factor = statistics.median(both)
    lines = []
    for problem, column, target, then, now in found:
        if not now and 1e-6 * then * factor * problems[problem].duration > budget:
            continue
        off = now / then / factor if then and now else math.nan
        lines.append([problem, column, f'{target:g}', brief(then), brief(now), brief(off),
                      '' if 0.5 <= off <= 2.0 else published.reason(problem, column, target, then, now)])
    return lines, factor


PUBLISHED_HEADER = ['problem', 'peer', 'error', 'then [µs/s]', 'here [µs/s]', 'relative', '']


def published_text(factor):
    return (f'Run times here are {factor:.2f} times those of an earlier comparison on another machine '
            '(median); the relative figure is each over that. Where it is beyond a factor of two, or '
            'only one of the two reached the error, what is known of why stands beside it.')


def read_csv(path):
    if not path.exists():
        return []
    with open(path, newline='') as file:
        return list(csv.DictReader(line for line in file if ',' in line))


def write_sizes(output, sizes):
    with open(output / 'scaling.csv', 'w', newline='') as file:
        writer = csv.DictWriter(file, list(SCALING_COLUMNS), lineterminator='\n')
        writer.writeheader()
        writer.writerows({name: f'{value:.4g}' if isinstance(value, float) else value
                          for name, value in row.items()} for row in sizes)


def write_references(output, problems, own_errors):
    with open(output / 'references.csv', 'w', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(REFERENCE_COLUMNS)
        writer.writerows([name, problems[name].source, f'{own_errors[name]:.2g}']
                         for name in sorted(own_errors))


def micro_body(micro):
    kept = [row for row in micro if row['name'].endswith('_median')]
    return ['<h2>Micro figures</h2>', table(
        ['benchmark (median of 5)', 'ns', 'ns per item'],
        [[row['name'], brief(float(row['cpu_time'])),
          brief(1e9 / float(row['items_per_second']) if row['items_per_second'] else math.nan)]
         for row in kept])]


def grid_parts(output, rows, problems):
    """Writes grid.html; returns HTML that sums it up."""
    grid = figures.verdicts(rows, problems)
    if not grid:
        return []
    contestants = sorted({name for found in grid.values() for name in found},
                         key=lambda name: (not figures.is_ours(name), name))
    (output / 'grid.html').write_text(page('Stability', grid_body(
        grid, problems, contestants, 'two seconds (longer where ticks are scaled)')))
    exploded = ' '.join(exploded_of(grid, name) for name in contestants if figures.is_ours(name))
    return [f'<h2>Stability, case by case</h2><p>{html.escape(exploded)} <a href="grid.html">The grid</a>.</p>']


def write_details(output, blocks, rows, sizes, problems, own_errors, budget):
    """Writes index.html: the page `blocks`, and all that is measured. `rows` are those of the diagrams, the grid and
    the scenes of many bodies."""
    runs = figures.runs_of(rows['diagrams'])
    style = plots.styles(sorted({name for found in runs.values() for name in found},
                                key=lambda name: (not figures.is_ours(name), name)))
    (output / 'diagrams').mkdir(exist_ok=True)
    for name, found in runs.items():
        plots.diagram(name, found, style, output / 'diagrams' / f'{name}.svg')
    if sizes:
        write_sizes(output, sizes)
    write_references(output, problems, own_errors)
    (output / 'raw_columns.md').write_text(
        '`nan`: there is nothing to compare with. micro.csv is as Google Benchmark writes it.\n\n' + columns_text([
            ('cells.csv, grid.csv and many.csv', cells.COLUMNS), ('references.csv', REFERENCE_COLUMNS),
            ('scaling.csv', SCALING_COLUMNS)]))
    table_lines, classes = comparison_lines(figures.comparison(runs))
    beside, factor = published_lines(runs, problems, budget)
    micro = read_csv(output / 'micro.csv')
    body = ['<h1>All that was measured</h1>', '<h2>Run time to an error</h2>',
            f'<p>{JUDGED_BY} Green: at least ten times less run time than the best other engine. Red: the other engine '
            'is faster.</p>', table(HEADER, table_lines, classes),
            f'<h2>A diagram for each problem</h2><p>{FRONT_TEXT}</p>',
            *(f'<h3>{name}</h3><img src="diagrams/{name}.svg" loading="lazy" alt="error against run time of {name}">'
              for name in sorted(runs)),
            '<h2>All contestants</h2><p>Least run time [µs/s] to each error.</p>',
            table(CONTESTANT_HEADER, contestant_lines(runs)), *grid_parts(output, rows['grid'], problems)]
    if micro:
        body += micro_body(micro)
    if beside:
        body += [f'<h2>Other engines beside an earlier comparison</h2><p>{published_text(factor)}</p>',
                 table(PUBLISHED_HEADER, beside)]
    body.append('<p>Raw figures: ' + ', '.join(
        f'<a href="{name}.csv">{name}.csv</a>' for name in ('cells', 'grid', 'many', 'scaling', 'references')
        if (output / f'{name}.csv').exists()) + '; <a href="raw_columns.md">their columns</a>.</p>')
    write_html(output / 'index.html', TITLE, blocks, '\n'.join(body))
