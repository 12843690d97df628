"""Parts that the pages of the report and of a sweep's `--report` share."""
import html
import math
import os
import pathlib
import statistics

from . import figures

AIM = 10.0  # times less run time than the best peer, at 1e-4 and 1e-6
STYLE = """body{font:14px/1.5 sans-serif;max-width:1200px;margin:2em auto;padding:0 1em}
table{border-collapse:collapse;margin:1em 0}td,th{padding:2px 8px;border:1px solid #ddd}
td{text-align:right}td:first-child,th:first-child{text-align:left}.win{background:#dff2df}
.loss{background:#fbd9d9}img{max-width:100%}.grid td{padding:1px 3px;font-size:9px;border:1px solid
#fff}.grid th{font-size:10px;background:#fff;position:sticky;top:0}.grid td:first-child{font-size:11px}
"""


def processor():
    """Returns the name of the processor on which run times were measured."""
    for line in pathlib.Path('/proc/cpuinfo').read_text().splitlines():
        if line.startswith('model name'):
            return f'{line.split(":")[1].strip()}, {os.cpu_count()} threads'
    return f'unknown processor, {os.cpu_count()} threads'


def brief(value):
    """Three digits for people."""
    if value is None or math.isnan(value):
        return '–'
    return f'{value:.3g}'


def page(title, body):
    return (f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}'
            f'</title><style>{STYLE}</style><body><h1>{html.escape(title)}</h1>\n{body}</body></html>\n')


def table(header, lines, classes=None):
    """Returns an HTML table of texts; `classes` gives a CSS class for each line."""
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


CONTESTANT_HEADER = ['problem', 'contestant', *(f'{t:g}' for t in figures.TARGETS), 'least error']
FRONT_TEXT = 'Shaded and ringed: the Pareto front of all contestants.'


def contestant_lines(runs):
    """Returns a line for each problem and contestant: the least run time to each error, and the least error."""
    lines = []
    for name in sorted(runs):
        for contestant, found in sorted(runs[name].items()):
            lines.append([name, contestant, *(brief((best := figures.time_to(found, target))
                                                    and best.time) for target in figures.TARGETS),
                          brief(min((figures.judged(run.errors) for run in found
                                     if run.outcome == 'ok'), default=math.nan))])
    return lines


def grid_body(grid, problems, contestants, length):
    """`length` of a run, in words."""
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
    return f"""<style>{colours}</style>
<p>{legend}</p>
<p>A cell is one run of {length}; for each contestant from the longest tick on. The number is the
decimal logarithm of the worst figure: position error over the size L of the scene (orientation in
rad, whichever is larger), or where there is no reference of energy and constraint error. <i>exact</i>:
position error ≤ 1e-6 L; <i>exploded</i>: not finite, position error (without a reference the way from
the start) above 10 L or energy above 10 times its scale; <i>stretched</i>: constraint error above 1e-2 L; <i>drifting</i>: energy above 1 %; <i>too
slow</i>: not done within the budget; <i>n/a</i>: cannot be expressed. Input that is invalid is
exact where it is refused and exploded where it is accepted. Error-controlled engines take ticks as the times between which they
choose their own steps. The mouse shows a cell's figures.</p>
<table class="grid">{chr(10).join(rows)}</table>"""


def count_lines(counts, contestants):
    kinds = [kind for kind in figures.CLASSES if any(counts[name][kind] for name in contestants)]
    return ['contestant', *kinds], [[name, *(str(counts[name][kind]) for kind in kinds)]
                                    for name in contestants]


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
