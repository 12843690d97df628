"""Writes the report: index.html with its plots, grid.html, summary.md and columns.md."""
import csv
import html
import math
import statistics

import package_path  # noqa: F401
from constraint_sim.sweep import figures, plots
from constraint_sim.sweep.report_pages import (
    CONTESTANT_HEADER, FRONT_TEXT, HEADER, JUDGED_BY, brief, comparison_lines, contestant_lines, count_lines,
    exploded_of, grid_body, judgement, markdown_table, page, table)

import cells
import published

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


HONESTY = [
    'One thread of one machine; nothing is said of engines in parallel or on other processors.',
    'Errors are taken each 0.1 s, of the states an engine reports; velocities enter only energy and '
    'momentum.',
    'Each engine is used as its documentation suggests, through one adapter written for this report; '
    'somebody who knows it better may get more out of it. Point masses have small inertias where an '
    'engine insists on one.',
    'Ticks are those that divide 0.1 s, tolerances powers of ten: a finer choice moves a run time '
    'by up to the factor between two of them.',
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


def many_lines(rows):
    """Returns lines for each scene of many bodies, fastest first."""
    lines = []
    for problem, contestants in sorted(figures.runs_of(rows).items()):
        done = [(name, run) for name, (run,) in contestants.items() if run.outcome != 'unsupported']
        for name, run in sorted(done, key=lambda pair: (math.isnan(pair[1].time), pair[1].time)):
            lines.append([problem, name, run.outcome.replace('_', ' '), brief(run.time * 1e-6),
                          *(brief(run.errors[measure]) for measure in MANY_ERRORS)])
    return lines


MANY_ERRORS = ('position', 'orientation', 'constraint', 'energy')
MANY_HEADER = ['problem', 'contestant', 'outcome', 'run time per second [s/s]',
               *(figures.MEASURES[name] for name in MANY_ERRORS)]
MANY_TEXT = ('One tick of 1/240 s after the other with the tolerances that each engine has by itself. '
             'What is too slow was stopped at the budget: its figures are of the part until then. '
             'net_32 is the net of 1984 rods and two that hold its corners.')


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
SLOPE_TEXT = ('Run time of a tick of 1 ms and memory from 10 links, bodies or contacts on, each '
              'contestant as far as the budget goes; the slope is the exponent of the growth, and what '
              'one costs is taken where there are most.')


def write_sizes(output, sizes):
    plots.scaling(sizes, output / 'scaling.svg')
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


def write_columns(output):
    described = [('cells.csv, grid.csv and many.csv', cells.COLUMNS),
                 ('references.csv', REFERENCE_COLUMNS), ('scaling.csv', SCALING_COLUMNS)]
    (output / 'columns.md').write_text(
        '`nan`: there is nothing to compare with. micro.csv is as Google Benchmark writes it.\n\n' +
        '\n'.join(f'# Columns of {name}\n\n' + markdown_table(
            ['column', 'meaning'], [[f'`{column}`', text] for column, text in columns.items()])
            for name, columns in described))


def spread_of(runs):
    """Returns the spread between rounds, which a single round cannot show."""
    median, worst = figures.spread(runs)
    if math.isnan(median):
        return ', too few to tell how far they lie apart'
    return (f'; the median of the rounds is above it by {100 * median:.0f} % (median of all '
            f'settings), at most {100 * worst:.0f} %')


def conditions_of(facts, runs, variants, own_errors, grid, many, sizes):
    """Returns the conditions of the measurement: programs, machine and duration."""
    versions = sorted({f'{variant.engine} {variant.version}' for variant in variants})
    return [f'{key}: {facts[key]}' for key in ('processor', 'system', 'compiler', 'commit')] + [
        'engines: ' + ', '.join(versions),
        'absent peers: ' + (', '.join(facts['absent']) or 'none'),
        f'{facts["kind"]} run, measured in {facts["measured in"]}; each time the best of '
        f'{facts["rounds"]} interleaved rounds' + spread_of(runs),
        f'budget of a run: {facts["budget"]:g} s' +
        (f', in the stability grid {facts["grid_budget"]:g} s' if grid else '') +
        (f', with many bodies {facts["many_budget"]:g} s' if many else '') +
        (f', of a size {facts["sizes_budget"]:g} s' if sizes else ''),
        f'largest error of a reference of the diagrams: '
        f'{max((own_errors.get(name, 0.0) for name in runs), default=0.0):.1g} m (references.csv)']


def micro_body(micro):
    kept = [row for row in micro if row['name'].endswith('_median')]
    return ['<h2>Micro figures</h2>', table(
        ['benchmark (median of 5)', 'ns', 'ns per item'],
        [[row['name'], brief(float(row['cpu_time'])),
          brief(1e9 / float(row['items_per_second']) if row['items_per_second'] else math.nan)]
         for row in kept])]


def write(output, rows, sizes, problems, variants, own_errors, facts):
    """Writes the report. `rows` are those of the diagrams, the grid and the scenes of many bodies."""
    runs = figures.runs_of(rows['diagrams'])
    contestants = sorted({name for found in runs.values() for name in found},
                         key=lambda name: (not figures.is_ours(name), name))
    style = plots.styles(contestants)
    for name, found in runs.items():
        plots.diagram(name, found, style, output / f'{name}.svg')
    lines = figures.comparison(runs)
    plots.ratios(lines, output / 'ratios.svg')
    grid = figures.verdicts(rows['grid'], problems)
    in_grid = sorted({name for found in grid.values() for name in found},
                     key=lambda name: (not figures.is_ours(name), name))
    counts = figures.counts(grid)
    if sizes:
        write_sizes(output, sizes)
    micro = read_csv(output / 'micro.csv')
    many = many_lines(rows['many'])
    slopes = slope_lines(sizes)
    if grid:
        (output / 'grid.html').write_text(page('Stability', grid_body(
            grid, problems, in_grid, 'two seconds (longer where ticks are scaled)')))
    write_references(output, problems, own_errors)
    write_columns(output)
    conditions = conditions_of(facts, runs, variants, own_errors, grid, many, sizes)
    texts = judgement(lines)
    header, counted = count_lines(counts, in_grid)
    stability = f'{len(grid)} cases. ' + ' '.join(exploded_of(grid, name) for name in in_grid
                                                  if figures.is_ours(name))
    beside, factor = published_lines(runs, problems, facts["budget"])

    write_markdown(output, facts, texts, lines, stability, header, counted, many, slopes, beside, factor,
                   conditions)
    table_lines, classes = comparison_lines(lines)
    body = ['<ul>', *(f'<li>{html.escape(text)}</li>' for text in conditions), '</ul>',
            '<h2>Run time to an error</h2>',
            *(f'<p>{html.escape(text)}</p>' for text in texts),
            '<img src="ratios.svg" alt="ratios of run times">',
            f'<p>{JUDGED_BY} Green: at least ten times less run time than the best peer. Red: the '
            'peer wins.</p>',
            table(HEADER, table_lines, classes),
            f'<h2>Diagrams</h2><p>{FRONT_TEXT}</p>',
            *(f'<h3>{name}</h3><img src="{name}.svg" alt="error against run time of {name}">'
              for name in sorted(runs)),
            '<h2>All contestants</h2><p>Least run time [µs/s] to each error.</p>',
            table(CONTESTANT_HEADER, contestant_lines(runs))]
    if grid:
        body += [f'<h2>Stability</h2><p>{html.escape(stability)} <a href="grid.html">The grid</a>.</p>',
                 table(header, counted)]
    if many:
        body += [f'<h2>Many bodies at 1/240 s</h2><p>{html.escape(MANY_TEXT)}</p>',
                 table(MANY_HEADER, many)]
    if sizes:
        body += [f'<h2>Scaling</h2><p>{html.escape(SLOPE_TEXT)}</p>'
                 '<img src="scaling.svg" alt="cost of a tick against size">', table(SLOPE_HEADER, slopes)]
    if micro:
        body += micro_body(micro)
    if beside:
        body += [f'<h2>Peers beside an earlier comparison</h2><p>{published_text(factor)}</p>',
                 table(PUBLISHED_HEADER, beside)]
    body += ['<h2>What this does not measure</h2><ul>',
             *(f'<li>{html.escape(text)}</li>' for text in HONESTY), '</ul>',
             '<p>Raw figures: ' + ', '.join(
                 f'<a href="{name}.csv">{name}.csv</a>'
                 for name in ('cells', 'grid', 'many', 'scaling', 'references')
                 if (output / f'{name}.csv').exists()) +
             '; <a href="columns.md">their columns</a>.</p>']
    (output / 'index.html').write_text(page('constraint_sim: error against run time', '\n'.join(body)))


def write_markdown(output, facts, texts, lines, stability, header, counted, many, slopes, beside,
                   factor, conditions):
    parts = ['# Error against run time\n',
             'Written by `./scripts/report' +
             (f' --{facts["kind"]}' if facts['kind'] in ('quick', 'mechanisms', 'events') else '') + '`; '
             'open [index.html](index.html) in a browser for the diagrams.\n',
             '\n'.join(f'- {text}' for text in texts) + '\n',
             '![ratios](ratios.svg)\n',
             f'{JUDGED_BY} Ratio: run time of the best peer over ours; bold where the peer wins.\n',
             markdown_table(HEADER, [[*line[:-1], f'**{line[-1]}**' if kind == 'loss' else line[-1]]
                                     for line, kind in zip(*comparison_lines(lines))]),
             *(['## Stability\n', stability + ' Grid: grid.html.\n', markdown_table(header, counted)]
               if counted else []),
             *(['## Many bodies at 1/240 s\n', MANY_TEXT + '\n', markdown_table(MANY_HEADER, many)]
               if many else []),
             *(['## Scaling\n', SLOPE_TEXT + '\n', markdown_table(SLOPE_HEADER, slopes)]
               if slopes else []),
             *(['## Peers beside an earlier comparison\n', published_text(factor) +
                f' Of {len(beside)} figures those that differ:\n',
                markdown_table(PUBLISHED_HEADER, [line for line in beside if line[-1]])]
               if beside else []),
             '## Conditions\n', '\n'.join(f'- {text}' for text in conditions) + '\n',
             '## What this does not measure\n', '\n'.join(f'- {text}' for text in HONESTY) + '\n']
    (output / 'summary.md').write_text('\n'.join(parts))
