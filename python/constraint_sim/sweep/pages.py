"""The summary of a study: limits, counts, plots; index.html and summary.md."""
import collections
import html
import math
import statistics

from .study import CHOICES

OUTCOMES = {'ok': '#1a7f37', 'too_slow': '#c8c8c8', 'failed': '#d7263d', 'refused': '#b39ddb', 'unsupported': '#e0e0e0',
            'hung': '#777777', 'crashed': '#6b1d5c'}
MOST_LINES = 20
UNITS = {'position_error': 'm', 'orientation_error': 'rad', 'max_constraint_error': 'm', 'max_penetration': 'm',
         'distance': 'm', 'scene_size': 'm', 'accumulated_local_error': 'm', 'energy_initial': 'J', 'energy_final': 'J',
         'energy_drift': '1', 'energy_error': '1', 'correction_work': 'J', 'driven_work': 'J',
         'solver_residual': 'm/s', 'run_time': 's', 'time_step': 's'}


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def series(table, x, y, apart=()):
    """(scene, label of the line) -> [(x, median y)]; rows that differ in anything but x, y, scene and the
    choices are taken together."""
    varied = [name for name in (*CHOICES, *apart) if name != x and
              len({str(row.get(name)) for row in table}) > 1]
    gathered = collections.defaultdict(lambda: collections.defaultdict(list))
    for row in table:
        if row['outcome'] == 'ok' and is_number(row.get(x)) and is_number(row.get(y)):
            label = ', '.join(f'{row[name]:g} s' if name == 'time_step' else
                              f'to {row[name]:g}' if name == 'tolerance' else
                              f'{row[name]}' if name == 'method' else f'{name} {row[name]}'
                              for name in varied if row.get(name) is not None)
            gathered[row['scene'], label][row[x]].append(row[y])
    return {key: [(at, statistics.median(values)) for at, values in sorted(points.items())]
            for key, points in gathered.items()}


def work_precision(table):
    """(scene, method) -> [(run time, error)] over ticks and tolerances, medians over the parameters.
    Only of one worker: times of different machines are not compared."""
    hosts = collections.Counter(row.get('worker') for row in table)
    host = hosts.most_common(1)[0][0] if hosts else None
    gathered = collections.defaultdict(list)
    for row in table:
        if row['outcome'] == 'ok' and row.get('worker') == host and is_number(row.get('position_error')) and \
                is_number(row.get('run_time')):
            gathered[row['scene'], row['method'], row['time_step'], row['tolerance']].append(row)
    found = collections.defaultdict(list)
    for (scene, method, _, _), rows in gathered.items():
        found[scene, method].append((statistics.median(row['run_time'] for row in rows),
                                     statistics.median(row['position_error'] for row in rows)))
    return {key: sorted(points) for key, points in found.items()}, len(hosts)


def limit_lines(study, table):
    """How far each may go: one line for each limit of the study and each way to run it."""
    lines = []
    for limit in study.limits if isinstance(study.limits, list) else [study.limits] if study.limits else []:
        of, error, below = limit['of'], limit['error'], limit['below']
        others = [each.name for each in study.parameters if each.name != of and not each.draw]
        varied = [name for name in ('scene', *CHOICES, *others) if name != of and
                  len({str(row.get(name)) for row in table}) > 1] or ['method']
        groups = collections.defaultdict(list)
        for row in table:
            groups[tuple(row.get(name) for name in varied)].append(row)
        for key, rows in groups.items():
            by_value = collections.defaultdict(list)
            for row in rows:
                by_value[row[of]].append(row['outcome'] == 'ok' and is_number(row.get(error)) and
                                         row[error] <= below)
            good = bad = None
            for value in sorted(by_value):
                if not all(by_value[value]):
                    bad = value
                    break
                good = value
            name = ', '.join(f'{part:g}' if isinstance(part, float) else str(part) for part in key)
            if good is None:
                lines.append(f'{name}: {error} is not below {below:g} even at the least {of}, {bad:g}')
            elif bad is None:
                lines.append(f'{name}: {error} stays below {below:g} at every {of}, up to {good:g}')
            else:
                lines.append(f'{name}: {error} stays below {below:g} up to {of} {good:g}, and no longer at '
                             f'{bad:g}')
    return lines


def summary(study, table, missing):
    outcomes = collections.Counter(row['outcome'] for row in table)
    lines = [f'{len(table)} cases: ' + ', '.join(f'{count} {name}' for name, count in sorted(outcomes.items()))
             + (f'; {missing} are missing' if missing else '')]
    lines += limit_lines(study, table)
    unsupported = collections.Counter((row['method'], row['warnings']) for row in table
                                      if row['outcome'] == 'unsupported')
    lines += [f'{method} cannot express the scene: {why}' for (method, why), _ in unsupported.most_common()]
    bad = [row for row in table if row['outcome'] not in ('ok', 'unsupported')]
    for row in bad[:MOST_LINES]:
        where = ', '.join(f'{name} {row[name]}' for name in
                          (*(each.name for each in study.parameters), *CHOICES) if row.get(name) is not None)
        lines.append(f'case {row["case"]} {row["outcome"]}: {where} ({row.get("warnings", "")})')
    if len(bad) > MOST_LINES:
        lines.append(f'and {len(bad) - MOST_LINES} more that are not ok')
    warned = collections.Counter(part for row in table if row['outcome'] == 'ok'
                                 for part in str(row.get('warnings') or '').split('; ') if part)
    lines += [f'{count} cases: {warning}' for warning, count in warned.most_common(MOST_LINES)]
    return lines


# ---- plots

def plotter():
    import matplotlib
    matplotlib.use('Agg')
    matplotlib.rcParams['svg.hashsalt'] = 'constraint_sim'  # equal figures give equal files
    from matplotlib import pyplot
    return pyplot


def wants_log(values):
    """Positive and over more than a factor of 30."""
    values = [value for value in values if value != 0.0]
    return bool(values) and min(values) > 0.0 and max(values) > 30.0 * min(values)


def label_of(column):
    return f'{column} [{UNITS[column]}]' if column in UNITS else column


def save(pyplot, figure, path):
    figure.tight_layout()
    figure.savefig(path, metadata={'Date': None})
    pyplot.close(figure)
    return path.name


def lines_plot(path, lines, x, y, title, level=None, marks=None):
    pyplot = plotter()
    figure, axes = pyplot.subplots(figsize=(7.5, 4.8))
    if len(lines) > 10:
        axes.set_prop_cycle(color=pyplot.get_cmap('tab20').colors)
    for label, points in lines.items():
        axes.plot(*zip(*points), 'o-', markersize=4, label=label or y)
    xs = [point[0] for points in lines.values() for point in points]
    ys = [point[1] for points in lines.values() for point in points] + ([level] if level else [])
    if wants_log(xs):
        axes.set_xscale('log')
    if wants_log([value for value in ys if value > 0.0]) and all(value >= 0.0 for value in ys):
        axes.set_yscale('log')
    if level is not None:
        axes.axhline(level, color='black', linestyle='--', linewidth=1)
    axes.set(xlabel=label_of(x), ylabel=label_of(y), title=title)
    axes.grid(True, alpha=0.3)
    if len(lines) > 1:
        axes.legend(fontsize='small', loc='upper left', bbox_to_anchor=(1, 1))
    return save(pyplot, figure, path)


def outcome_map(path, table, x, y, title):
    """Draws a map of the outcomes of one method over two parameters, with errors where a run succeeded."""
    pyplot = plotter()
    figure, axes = pyplot.subplots(figsize=(7.5, 4.8))
    errors = {}
    for name, colour in OUTCOMES.items():
        rows = [row for row in table if row['outcome'] == name and is_number(row[x]) and is_number(row[y])]
        if name == 'ok':
            measure = 'position_error' if any(is_number(row.get('position_error')) for row in rows) \
                else 'max_constraint_error'
            errors = {(row[x], row[y]): max(errors.get((row[x], row[y]), 0.0), row.get(measure) or 0.0)
                      for row in rows}
            continue
        if rows:
            axes.scatter([row[x] for row in rows], [row[y] for row in rows], c=colour, marker='s', s=60,
                         label=name, zorder=3)
    if errors:
        logs = [math.log10(max(error, 1e-16)) for error in errors.values()]
        points = axes.scatter(*zip(*errors), c=logs, marker='s', s=60, cmap='viridis', label='ok')
        figure.colorbar(points, label=f'log10 {measure} of what is ok')
    for axis, name in (('x', x), ('y', y)):
        if wants_log([row[name] for row in table if is_number(row[name])]):
            getattr(axes, f'set_{axis}scale')('log')
    axes.set(xlabel=label_of(x), ylabel=label_of(y), title=title)
    axes.legend(fontsize='small', loc='upper left', bbox_to_anchor=(0, -0.12), ncol=6)
    return save(pyplot, figure, path)


def wanted_plots(study, table):
    if study.plots is not None:
        return study.plots if isinstance(study.plots, list) else [study.plots]
    measure = 'position_error' if study.reference else 'max_constraint_error'
    return [{'x': each.name, 'y': measure} for each in study.parameters
            if all(is_number(value) for value in each.values)]


def write_plots(folder, study, table):
    names = []
    curves, hosts = work_precision(table)
    for scene in study.scenes:
        lines = {method: points for (where, method), points in curves.items()
                 if where == scene and any(error > 0.0 for _, error in points)}
        if lines:
            note = ' (of one of the workers)' if hosts > 1 else ''
            names.append(lines_plot(folder / f'work_precision_{scene}.svg', lines,
                                    f'run time of {study.duration:g} s [s]{note}', 'position error [m]', scene))
        for plot in wanted_plots(study, table):
            found = series(table, plot['x'], plot['y'], [plot['of']] if 'of' in plot else ())
            lines = {label: points for (where, label), points in found.items() if where == scene}
            if lines:
                names.append(lines_plot(folder / f'{plot["y"]}_over_{plot["x"]}_{scene}.svg', lines, plot['x'],
                                        plot['y'], plot.get('title', scene), plot.get('line')))
        axes = [each.name for each in study.parameters if all(is_number(value) for value in each.values)]
        if len(study.time_steps) > 1:
            axes.append('time_step')
        if len(axes) >= 2:
            for method in study.methods:
                rows = [row for row in table if row['scene'] == scene and row['method'] == method.name]
                if rows:
                    names.append(outcome_map(folder / f'outcome_{scene}_{method.name}.svg', rows, axes[0],
                                             axes[1], f'{scene}, {method.name}'))
    return names


def best_rows(table):
    """For each scene and method: cases, outcomes, worst values, median run time."""
    groups = collections.defaultdict(list)
    for row in table:
        groups[row['scene'], row['method']].append(row)
    for (scene, method), rows in groups.items():
        good = [row for row in rows if row['outcome'] == 'ok']
        worst = [max((row[name] for row in good if is_number(row.get(name))), default=math.nan)
                 for name in ('position_error', 'max_constraint_error', 'run_time')]
        yield [scene, method, f'{len(good)} of {len(rows)}',
               *('–' if math.isnan(value) else f'{value:.3g}' for value in worst)]


def write(folder, study, table, missing, plots=True):
    """Writes both pages; returns the lines of the summary."""
    lines = summary(study, table, missing)
    names = write_plots(folder, study, table) if plots and table else []
    head = ['scene', 'method', 'ok', 'worst position error [m]', 'worst constraint error [m]',
            'longest run time [s]']
    rows = list(best_rows(table))
    title = study.source
    text = [f'# {title}', '', *(f'- {line}' for line in lines), '', '| ' + ' | '.join(head) + ' |',
            '| ' + ' | '.join('---' for _ in head) + ' |', *('| ' + ' | '.join(row) + ' |' for row in rows), '',
            *(f'![{name}]({name})' for name in names), '']
    (folder / 'summary.md').write_text('\n'.join(text))
    cell = html.escape
    page = ['<!doctype html><meta charset="utf-8">', f'<title>{cell(title)}</title>',
            '<style>body{font-family:sans-serif;max-width:60em;margin:2em auto}td,th{padding:.2em .6em;'
            'text-align:left}img{max-width:100%}</style>', f'<h1>{cell(title)}</h1><ul>',
            *(f'<li>{cell(line)}</li>' for line in lines), '</ul><table>',
            '<tr>' + ''.join(f'<th>{cell(name)}</th>' for name in head) + '</tr>',
            *('<tr>' + ''.join(f'<td>{cell(value)}</td>' for value in row) + '</tr>' for row in rows),
            '</table>', *(f'<p><img src="{cell(name)}" alt="{cell(name)}"></p>' for name in names)]
    (folder / 'index.html').write_text('\n'.join(page) + '\n')
    return lines


