"""Writes the report: index.html with its plots, grid.html, summary.md and columns.md."""
import csv
import html
import math
import statistics

import cells
import figures
import plots
import published

AIM = 10.0  # times less run time than the best peer, at 1e-4 and 1e-6
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
STYLE = """body{font:14px/1.5 sans-serif;max-width:1200px;margin:2em auto;padding:0 1em}
table{border-collapse:collapse;margin:1em 0}td,th{padding:2px 8px;border:1px solid #ddd}
td{text-align:right}td:first-child,th:first-child{text-align:left}.win{background:#dff2df}
.loss{background:#fbd9d9}img{max-width:100%}.grid td{padding:1px 3px;font-size:9px;border:1px solid
#fff}.grid th{font-size:10px;background:#fff;position:sticky;top:0}.grid td:first-child{font-size:11px}
"""


def brief(value):
    """Three digits for people."""
    if value is None or math.isnan(value):
        return '–'
    return f'{value:.3g}'


def page(title, body):
    return (f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}'
            f'</title><style>{STYLE}</style><body><h1>{html.escape(title)}</h1>\n{body}</body></html>\n')


def table(header, lines, classes=None):
    """Of cells that are texts; `classes` gives a CSS class for each line."""
    rows = ['<tr>' + ''.join(f'<th>{html.escape(cell)}</th>' for cell in header) + '</tr>']
    for i, line in enumerate(lines):
        kind = f' class="{classes[i]}"' if classes and classes[i] else ''
        rows.append(f'<tr{kind}>' + ''.join(f'<td>{html.escape(cell)}</td>' for cell in line) + '</tr>')
    return '<table>' + '\n'.join(rows) + '</table>\n'


def markdown_table(header, lines):
    return '\n'.join('| ' + ' | '.join(line) + ' |'
                     for line in [header, ['---'] * len(header), *lines]) + '\n'


def short(contestant):
    return contestant.replace(f'{figures.OURS} ', '')


def setting(found):
    """`method at value`, of a pair of contestant and run."""
    return f'{short(found[0])} at {found[1].value:.3g}' if found else '–'


def comparison_lines(lines):
    table_lines, classes = [], []
    for problem, target, ours, peer, ratio in lines:
        table_lines.append([problem, f'{target:g}', brief(ours and ours[1].time), setting(ours),
                            brief(peer and peer[1].time), setting(peer), brief(ratio)])
        classes.append('' if math.isnan(ratio) else 'win' if ratio >= AIM else
                       'loss' if ratio < 1.0 else '')
    return table_lines, classes


HEADER = ['problem', 'error', 'ours [µs/s]', 'with', 'best peer [µs/s]', 'with', 'ratio']


JUDGED_BY = ('Error: largest position error in metres or orientation error in radians, each 0.1 s; of scenes '
             'without a reference the worst of joints [m], penetration [m] and energy.')


def judgement(lines):
    """Sentences on where the aim is met, where peers win, and what only one side reaches."""
    aimed = [line for line in lines if line[1] in (1e-4, 1e-6) and not math.isnan(line[4])]
    met = [line for line in aimed if line[4] >= AIM]
    lost = [line for line in lines if line[4] < 1.0]
    alone = [line for line in lines if line[2] and not line[3]]
    behind = [line for line in lines if line[3] and not line[2]]
    def name(line):
        return f'{line[0]} to {line[1]:g}'
    missed = [line for line in aimed if line[4] < AIM]
    texts = [f'At 1e-4 and 1e-6 the best peer takes at least {AIM:g} times our run time in '
             f'{len(met)} of {len(aimed)} cases that both reach'
             + (f'; the median ratio is {statistics.median(line[4] for line in aimed):.3g}.'
                if aimed else '.')]
    if missed:
        texts.append('Below that: ' + ', '.join(f'{name(line)} ({line[4]:.2g})'
                                                for line in missed) + '.')
    texts.append('A peer wins: ' + (', '.join(f'{name(line)} ({line[3][0]}, ratio {line[4]:.2g})'
                                              for line in lost) or 'nowhere') + '.')
    texts.append('Reached within the budget by us alone: ' + (', '.join(map(name, alone)) or 'nothing') + '.')
    texts.append('Reached within the budget by a peer alone: ' + (', '.join(
        f'{name(line)} ({line[3][0]})' for line in behind) or 'nothing') + '.')
    return texts


def published_lines(runs, problems, budget):
    """Each peer's time beside the earlier one, over the median of that, and why where far off, or
    where only one of the two comparisons has a time. What cannot be within the budget here says
    nothing."""
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


def grid_page(grid, problems, contestants):
    ticks = {}
    for name, found in grid.items():
        ticks[name] = [cell[0] for cell in next(iter(found.values()))]
    width = max(map(len, ticks.values()), default=0)
    head = '<tr><th>case</th>' + ''.join(
        f'<th colspan="{width}">{html.escape(name.replace("_", " "))}</th>' for name in contestants)
    rows, group = [head + '</tr>'], None
    for name in sorted(grid, key=lambda case: (problems[case].group, case)):
        if problems[name].group != group:
            group = problems[name].group
            rows.append(f'<tr><td colspan="{1 + width * len(contestants)}"><b>{group}</b></td></tr>')
        line = f'<tr><td>{name}</td>'
        for contestant in contestants:
            found = {tick: rest for tick, *rest in grid[name].get(contestant, [])}
            for tick in ticks[name]:
                kind, worst = found.get(tick, ('n/a', math.nan))
                text = '' if math.isnan(worst) else '∞' if math.isinf(worst) else \
                    '0' if worst == 0.0 else str(round(math.log10(worst)))
                line += (f'<td class="{kind[:3]}" '
                         f'title="tick {tick:.3g} s: {kind} {worst:.2g}">{text}</td>')
        rows.append(line + '</tr>')
    colours = ''.join(f'.{kind[:3]}{{background:{colour}}}'
                      for kind, colour in figures.CLASSES.items()).replace('n/a', 'n\\/a')
    legend = ' '.join(f'<span style="background:{colour};padding:2px 8px">{kind}</span>'
                      for kind, colour in figures.CLASSES.items())
    return page('Stability', f"""<style>{colours}</style>
<p>{legend}</p>
<p>A cell is one run of two seconds (longer where ticks are scaled); for each contestant from the longest tick on. The number is the
decimal logarithm of the worst figure: position error over the size L of the scene (orientation in
rad, whichever is larger), or where there is no reference of energy and constraint error. <i>exact</i>:
position error ≤ 1e-6 L; <i>exploded</i>: not finite, position error (without a reference the way from
the start) above 10 L or energy above 10 times its scale; <i>stretched</i>: constraint error above 1e-2 L; <i>drifting</i>: energy above 1 %; <i>too
slow</i>: not done within the budget; <i>n/a</i>: cannot be expressed. Input that is invalid is
exact where it is refused and exploded where it is accepted. Error-controlled engines take ticks as the times between which they
choose their own steps. The mouse shows a cell's figures.</p>
<table class="grid">{chr(10).join(rows)}</table>""")


def count_lines(counts, contestants):
    kinds = [kind for kind in figures.CLASSES if any(counts[name][kind] for name in contestants)]
    return ['contestant', *kinds], [[name, *(str(counts[name][kind]) for kind in kinds)]
                                    for name in contestants]


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


def exploded_of(grid, contestant):
    """A sentence on the cells of a contestant that exploded: each case with its ticks."""
    cases = {}
    for case, found in sorted(grid.items()):
        ticks = [f'{tick:.2g}' for tick, kind, _ in found.get(contestant, []) if kind == 'exploded']
        if ticks:
            cases[case] = ', '.join(ticks)
    count = sum(ticks.count(',') + 1 for ticks in cases.values())
    listed = '; '.join(f'{case} at {ticks} s' for case, ticks in cases.items())
    return f'{short(contestant)}: {count} exploded' + (f' ({listed}).' if cases else '.')


def many_lines(rows):
    """Of each scene of many bodies, the quickest first."""
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
    """Of each kind and contestant: exponents of time, instructions and memory, and what one more
    costs where there are most."""
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


def write(output, rows, sizes, problems, variants, own_errors, facts):
    """`rows` are those of the diagrams, the grid and the scenes of many bodies."""
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
    plots.scaling(sizes, output / 'scaling.svg')
    with open(output / 'scaling.csv', 'w', newline='') as file:
        writer = csv.DictWriter(file, list(SCALING_COLUMNS), lineterminator='\n')
        writer.writeheader()
        writer.writerows({name: f'{value:.4g}' if isinstance(value, float) else value
                          for name, value in row.items()} for row in sizes)
    micro = read_csv(output / 'micro.csv')
    many = many_lines(rows['many'])
    slopes = slope_lines(sizes)
    (output / 'grid.html').write_text(grid_page(grid, problems, in_grid))
    with open(output / 'references.csv', 'w', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(REFERENCE_COLUMNS)
        writer.writerows([name, problems[name].source, f'{own_errors[name]:.2g}']
                         for name in sorted(own_errors))
    described = [('cells.csv, grid.csv and many.csv', cells.COLUMNS),
                 ('references.csv', REFERENCE_COLUMNS), ('scaling.csv', SCALING_COLUMNS)]
    (output / 'columns.md').write_text(
        '`nan`: there is nothing to compare with. micro.csv is as Google Benchmark writes it.\n\n' +
        '\n'.join(f'# Columns of {name}\n\n' + markdown_table(
            ['column', 'meaning'], [[f'`{column}`', text] for column, text in columns.items()])
            for name, columns in described))

    versions = sorted({f'{variant.engine} {variant.version}' for variant in variants})
    median, worst = figures.spread(runs)
    conditions = [f'{key}: {facts[key]}' for key in ('processor', 'system', 'compiler', 'commit')] + [
        'engines: ' + ', '.join(versions),
        'absent peers: ' + (', '.join(facts['absent']) or 'none'),
        f'{facts["kind"]} run, measured in {facts["measured in"]}; each time the best of '
        f'{facts["rounds"]} interleaved rounds; the median of the rounds is above it by '
        f'{100 * median:.0f} % (median of all settings), at most {100 * worst:.0f} %',
        f'budget of a run: {facts["budget"]:g} s, in the stability grid {facts["grid_budget"]:g} s, '
        + (f'with many bodies {facts["many_budget"]:g} s, ' if many else '') +
        f'of a size {facts["sizes_budget"]:g} s',
        f'largest error of a reference of the diagrams: '
        f'{max((own_errors.get(name, 0.0) for name in runs), default=0.0):.1g} m (references.csv)']
    texts = judgement(lines)
    header, counted = count_lines(counts, in_grid)
    stability = f'{len(grid)} cases. ' + ' '.join(exploded_of(grid, name) for name in in_grid
                                                  if figures.is_ours(name))
    beside, factor = published_lines(runs, problems, facts["budget"])

    write_markdown(output, facts, texts, lines, stability, header, counted, many, slopes, beside, factor,
                   conditions)
    table_lines, classes = comparison_lines(lines)
    full = []
    for name in sorted(runs):
        for contestant, found in sorted(runs[name].items()):
            full.append([name, contestant, *(brief((best := figures.time_to(found, target))
                                                   and best.time) for target in figures.TARGETS),
                         brief(min((figures.judged(run.errors) for run in found
                                    if run.outcome == 'ok'), default=math.nan))])
    body = ['<ul>', *(f'<li>{html.escape(text)}</li>' for text in conditions), '</ul>',
            '<h2>Run time to an error</h2>',
            *(f'<p>{html.escape(text)}</p>' for text in texts),
            '<img src="ratios.svg" alt="ratios of run times">',
            f'<p>{JUDGED_BY} Green: at least ten times less run time than the best peer. Red: the '
            'peer wins.</p>',
            table(HEADER, table_lines, classes),
            '<h2>Diagrams</h2><p>Shaded and ringed: the Pareto front of all contestants.</p>',
            *(f'<h3>{name}</h3><img src="{name}.svg" alt="error against run time of {name}">'
              for name in sorted(runs)),
            '<h2>All contestants</h2><p>Least run time [µs/s] to each error.</p>',
            table(['problem', 'contestant', *(f'{t:g}' for t in figures.TARGETS), 'least error'], full),
            f'<h2>Stability</h2><p>{html.escape(stability)} <a href="grid.html">The grid</a>.</p>',
            table(header, counted)]
    if many:
        body += [f'<h2>Many bodies at 1/240 s</h2><p>{html.escape(MANY_TEXT)}</p>',
                 table(MANY_HEADER, many)]
    body += [f'<h2>Scaling</h2><p>{html.escape(SLOPE_TEXT)}</p>'
             '<img src="scaling.svg" alt="cost of a tick against size">', table(SLOPE_HEADER, slopes)]
    if micro:
        kept = [row for row in micro if row['name'].endswith('_median')]
        body += ['<h2>Micro figures</h2>', table(
            ['benchmark (median of 5)', 'ns', 'ns per item'],
            [[row['name'], brief(float(row['cpu_time'])),
              brief(1e9 / float(row['items_per_second']) if row['items_per_second'] else math.nan)]
             for row in kept])]
    if beside:
        body += [f'<h2>Peers beside an earlier comparison</h2><p>{published_text(factor)}</p>',
                 table(PUBLISHED_HEADER, beside)]
    body += ['<h2>What this does not measure</h2><ul>',
             *(f'<li>{html.escape(text)}</li>' for text in HONESTY), '</ul>',
             '<p>Raw figures: ' + ', '.join(
                 f'<a href="{name}.csv">{name}.csv</a>'
                 for name in ('cells', 'grid', 'many', 'scaling', 'references')) +
             '; <a href="columns.md">their columns</a>.</p>']
    (output / 'index.html').write_text(page('constraint_sim: error against run time', '\n'.join(body)))


def write_markdown(output, facts, texts, lines, stability, header, counted, many, slopes, beside,
                   factor, conditions):
    parts = ['# Error against run time\n',
             'Written by `./scripts/report' + (' --quick' if facts['kind'] == 'quick' else '') + '`; '
             'open [index.html](index.html) in a browser for the diagrams.\n',
             '\n'.join(f'- {text}' for text in texts) + '\n',
             '![ratios](ratios.svg)\n',
             f'{JUDGED_BY} Ratio: run time of the best peer over ours; bold where the peer wins.\n',
             markdown_table(HEADER, [[*line[:-1], f'**{line[-1]}**' if kind == 'loss' else line[-1]]
                                     for line, kind in zip(*comparison_lines(lines))]),
             '## Stability\n', stability + ' Grid: grid.html.\n', markdown_table(header, counted),
             *(['## Many bodies at 1/240 s\n', MANY_TEXT + '\n', markdown_table(MANY_HEADER, many)]
               if many else []),
             '## Scaling\n', SLOPE_TEXT + '\n', markdown_table(SLOPE_HEADER, slopes),
             *(['## Peers beside an earlier comparison\n', published_text(factor) +
                f' Of {len(beside)} figures those that differ:\n',
                markdown_table(PUBLISHED_HEADER, [line for line in beside if line[-1]])]
               if beside else []),
             '## Conditions\n', '\n'.join(f'- {text}' for text in conditions) + '\n',
             '## What this does not measure\n', '\n'.join(f'- {text}' for text in HONESTY) + '\n']
    (output / 'summary.md').write_text('\n'.join(parts))
