"""The report's plots, as SVG with text for text."""
import io
import math
import re

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402

from . import figures  # noqa: E402

plt.rcParams.update({'svg.fonttype': 'none', 'font.size': 8, 'axes.grid': True, 'grid.alpha': 0.3,
                     'svg.hashsalt': 'constraint_sim', 'axes.axisbelow': True})
HUES = {'constraint_sim': 'Reds', 'ode': 'Purples', 'bullet': 'Blues', 'mujoco': 'Greens',
        'simbody': 'Oranges', 'dart': 'Greys'}
MARKERS = 'osDv^P*X<>'
SMALLEST = 1e-17  # where errors of zero are drawn


def styles(contestants):
    """Ours in reds and thick, each peer in shades of its own; without peers a colour each."""
    found = {}
    engines = sorted({name.split()[0] for name in contestants})
    for engine in engines:
        own = sorted(name for name in contestants if name.split()[0] == engine)
        shades = plt.get_cmap(HUES.get(engine, 'cool'))
        for i, name in enumerate(own):
            shade = 0.9 - 0.5 * i / max(1, len(own) - 1)
            colour = shades(shade) if len(engines) > 1 else plt.get_cmap('tab10')(i % 10)
            found[name] = {'color': colour, 'marker': MARKERS[i % len(MARKERS)],
                           'linewidth': 1.8 if engine == 'constraint_sim' else 0.9,
                           'markersize': 4.0, 'zorder': 3 if engine == 'constraint_sim' else 2}
    return found


def save(figure, path):
    """As SVG in a third of the size: coordinates to a tenth of a point, and equal styles written once."""
    text = io.StringIO()
    figure.savefig(text, format='svg', metadata={'Date': None})
    plt.close(figure)
    svg = re.sub(r'<[^>]*>', lambda tag: re.sub(r'(\d+\.\d)\d+', r'\1', tag.group(0)),
                 text.getvalue())
    names = {}

    def shared(match):
        return f'class="s{names.setdefault(match.group(1), len(names))}"'

    svg = re.sub(r'style="([^"]*)"', shared, svg)
    rules = ''.join(f'.s{number}{{{style}}}' for style, number in names.items())
    svg = re.sub(r'<style type="text/css">', lambda match: match.group(0) + rules, svg, count=1)
    path.write_text('\n'.join(line.strip() for line in svg.splitlines()) + '\n')


def diagram(problem, contestants, style, path):
    """Error against run time, a panel for each measure that is known."""
    known = [name for name in figures.MEASURES if any(
        run.errors[name] > 0.0 for runs in contestants.values() for run in runs)]
    columns = min(3, len(known))
    rows = math.ceil(len(known) / columns)
    figure, axes = plt.subplots(rows, columns, figsize=(4.2 * columns, 3.1 * rows + 0.9),
                                squeeze=False)
    for axis in axes.flat[len(known):]:
        axis.set_visible(False)
    for axis, measure in zip(axes.flat, known):
        points = []
        for name, runs in sorted(contestants.items()):
            line = [(run.time, max(run.errors[measure], SMALLEST)) for run in runs
                    if run.outcome == 'ok' and not math.isnan(run.errors[measure])]
            if not line:
                continue
            points += line
            axis.plot(*zip(*line), label=name.replace('_', ' '), **style[name])
        front = figures.pareto(points)
        axis.step(*zip(*front), where='post', color='black', linewidth=4.0, alpha=0.18, zorder=1)
        axis.plot(*zip(*front), 'o', markerfacecolor='none', markeredgecolor='black', markersize=8,
                  markeredgewidth=0.6, zorder=4)
        axis.set(xscale='log', yscale='log', ylabel=figures.MEASURES[measure],
                 xlabel='run time per simulated second [µs]')
        top = max(error for _, error in points)
        axis.set_ylim(top=min(top * 3.0, 1e3))  # exploded runs have no place on a scale of errors
    handles, labels = {}, {}
    for axis in axes.flat:
        for handle, label in zip(*axis.get_legend_handles_labels()):
            handles[label] = handle
    figure.legend(handles.values(), handles.keys(), loc='lower center', ncol=4, frameon=False,
                  fontsize=7)
    figure.suptitle(problem)
    lines = math.ceil(len(handles) / 4)
    height = figure.get_figheight()
    figure.tight_layout(rect=(0.0, (0.17 * lines + 0.1) / height, 1.0, 1.0))
    save(figure, path)
