"""`--report`: error against run time and stability of all methods on one scene, by what judges and writes the
report (bench/report)."""
import collections
import html
import math
import pathlib
import statistics

import yaml

from . import figures, pages, report_pages
from .scene_template import PathError
from .study import Study, StudyError, number

SAMPLE = 0.1  # [s] between states that are compared
TICKS = (0.1, 0.05, 1 / 30, 0.02, 0.01, 0.005, 0.002, 0.001)  # [s]
TOLERANCES = [float(f'1e-{digits}') for digits in range(1, 13)]  # [m/s]
GRID_TICKS = (0.5, 0.1, 1 / 30, 1 / 60, 1 / 240, 1 / 1000)  # [s], as in bench/report/studies/grid.yaml
MASSES = (1e-3, 1e3, 1e6)  # times that of the heaviest body
STIFFNESSES = (1e3, 1e6)  # times that of each spring
ADAPTIVE = {  # the error decides how long their substeps are
    'auto': {'method': 'auto'},
    'runge_kutta_order_8': {'method': 'runge_kutta', 'order': 8},
    'runge_kutta_order_5': {'method': 'runge_kutta', 'order': 5}}
STEPPED = {
    'energy_momentum_order_4': {'method': 'energy_momentum', 'stiff_order': 4},
    'energy_momentum_order_2': {'method': 'energy_momentum', 'stiff_order': 2},
    'sequential_impulses_10': {'method': 'sequential_impulses', 'iterations': 10},
    'sequential_impulses_50': {'method': 'sequential_impulses', 'iterations': 50}}
TIME_LIMIT = 3.0  # [s] of a run
COLUMNS = {'position': 'position_error', 'orientation': 'orientation_error', 'energy': 'energy_error',
           'constraint': 'max_constraint_error', 'penetration': 'max_penetration', 'distance': 'distance'}

# studies: that of the diagram and those of the stability grid
ReportStudies = collections.namedtuple('ReportStudies', 'diagram grid notes')
# properties of a problem that figures.verdict reads
Scene = collections.namedtuple('Scene', 'group length invalid conflict')


def as_methods(choices, **own):
    return [{'name': name, **options, **own} for name, options in choices.items()]


def studies_of(path, duration, peers):
    path = pathlib.Path(path)
    if not is_multiple(number('--duration', duration, 0.0), SAMPLE):
        raise StudyError(f'--duration: must be a multiple of {SAMPLE} s, got {duration:g}')
    others = [{'name': label.replace(' ', '_'), 'peer': label} for label in peers
              if not label.startswith(figures.OURS + ' ')]
    common = {
        'scene': path.name, 'duration': duration, 'outputs': {'every': SAMPLE}, 'time_limit': TIME_LIMIT,
        # half the tick and a tenth of the tolerance of anything it is compared with
        'reference': {'run': {'method': 'runge_kutta', 'tolerance': 1e-13, 'time_step': TICKS[-1] / 2.0}}}
    made = 0

    def study(**keys):
        nonlocal made
        found = Study(yaml.safe_dump({**common, **keys}), path.parent, f'report of {path.name}', peers, first=made)
        made += found.count()
        return found

    diagram = study(
        methods=as_methods(ADAPTIVE, tolerances=TOLERANCES, time_steps=[SAMPLE]) + as_methods(
            {'auto_by_tick': {'method': 'auto'}, **STEPPED}) + others,
        time_steps=list(TICKS), rounds=3)
    grid = {'methods': as_methods({**ADAPTIVE, **STEPPED}) + others,
            'time_steps': [tick for tick in GRID_TICKS if is_multiple(duration, tick)]}
    extremes, notes = extremes_of(diagram.scenes[path.stem])
    return ReportStudies(diagram, [study(**grid), *(study(**grid, parameters=each) for each in extremes)], notes)


def is_multiple(duration, tick):
    return abs(round(duration / tick) * tick - duration) < 1e-9 * duration and duration >= tick


def extremes_of(template):
    """(parameters of a study each, what could not be made one): the heaviest of several bodies lighter and
    heavier, springs stiffer."""
    document = yaml.safe_load(template.text)
    bodies = numbered(document.get('bodies'), 'bodies', 'mass')
    springs = numbered(document.get('constraints'), 'constraints', 'stiffness')
    wanted = []
    if len(bodies) > 1:
        where, name, body = max(bodies, key=lambda entry: entry[2]['mass'])
        wanted.append((f'mass_of_{as_word(name)}', [f'{where}.{key}' for key in ('mass', 'inertia') if key in body],
                       MASSES))
    if springs:
        wanted.append(('stiffness', [f'{where}.stiffness' for where, _, _ in springs], STIFFNESSES))
    found, notes = [], []
    for name, paths, factors in wanted:
        try:
            for path in paths:
                template.multiplied(path, template.places(path), 1.0)
            found.append({name: {'path': paths, 'factors': list(factors)}})
        except PathError as error:
            notes.append(f'{name} is not varied: {error}')
    return found, notes


def numbered(entries, kind, key):
    """(path, name, entry) of the entries of a list, of what is dynamic, whose key is a finite number > 0."""
    found = []
    for index, entry in enumerate(entries or []):
        try:
            value = float(entry.get(key))
        except (TypeError, ValueError):
            continue
        if 0.0 < value < math.inf and entry.get('type') not in ('static', 'kinematic'):
            name = str(entry.get('name', index))
            found.append((f'{kind}.{name}', name, {**entry, key: value}))
    return found


def as_word(name):
    return ''.join(letter if letter.isalnum() else '_' for letter in name)


# ---- the page

def value_of(row, name):
    return row[name] if pages.is_number(row.get(name)) else math.nan


def report_rows(study, table, problem_of):
    """Rows as those of the report."""
    own = {each.name: each for each in study.methods}
    found = []
    for row in table:
        method, outcome = own[row['method']], row['outcome']
        if outcome == 'failed':  # this engine says so, of others it was seen
            outcome = 'not_finite' if method.peer else 'refused'
        simulated = value_of(row, 'sim_time')
        found.append({
            'round': 1, 'problem': problem_of(row), 'contestant': method.peer or f'{figures.OURS} {method.name}',
            'value': row['tolerance' if method.tolerances else 'time_step'], 'outcome': outcome,
            'run_time': 1e6 * value_of(row, 'run_time') / simulated if simulated > 0.0 else math.nan,
            'memory': math.nan, 'momentum': math.nan,
            **{name: value_of(row, column) for name, column in COLUMNS.items()}})
    return found


def grid_case(study, row):
    return ', '.join(f'{each.name} × {row[each.name]:g}' for each in study.parameters) or 'as it is'


def ordered(runs):
    return sorted({name for found in runs.values() for name in found},
                  key=lambda name: (not figures.is_ours(name), name))


def conditions(found, table, grid_table, program):
    spreads = [row['run_time_spread'] for row in table if pages.is_number(row.get('run_time_spread'))]
    errors = [row['reference_error'] for row in table if pages.is_number(row.get('reference_error'))]
    lines = [f'processor: {report_pages.processor()}', f'program: constraint_sim {program}',
             f'{found.diagram.duration:g} s of motion, compared each {SAMPLE:g} s; each time the best of '
             f'{found.diagram.rounds} interleaved rounds' + (
                 f'; the median of the rounds is above it by {100 * statistics.median(spreads):.0f} % (median of all '
                 'settings)' if spreads else ''),
             'reference: runge_kutta, tolerance 1e-13 m/s, tick 0.5 ms; ' + (
                 f'to ten times the tolerance and twice the tick it differs by {max(errors):.1g} m or rad: errors '
                 'below ten times that say little' if errors else 'its error is not known')]
    workers = {row['worker'] for row in table if row.get('worker')}
    if len(workers) > 1:
        lines.append(f'measured on {len(workers)} machines: run times are not comparable')
    lines += found.notes
    lost = dict.fromkeys((case, warning) for case, row in grid_table
                         for warning in str(row.get('warnings') or '').split('; ')
                         if warning.startswith(('no reference', 'the reference ')) and 'hardly' not in warning)
    return lines + [f'{case}: {warning}; judged by energy and joints' for case, warning in lost]


def write(folder, found, tables, missing, program, plots=True):
    """Writes the page and the summary; returns the lines of the latter."""
    scene, = found.diagram.scenes
    table, *grid_tables = tables
    runs = figures.runs_of(report_rows(found.diagram, table, lambda row: scene))
    grid_rows, grid_table = [], []
    for study, part in zip(found.grid, grid_tables):
        grid_rows += report_rows(study, part, lambda row, study=study: grid_case(study, row))
        grid_table += [(grid_case(study, row), row) for row in part]
    sizes = [value_of(row, 'scene_size') for row in table if value_of(row, 'scene_size') > 0.0]
    length = sizes[0] if sizes else 1.0  # [m]; of what rests nothing can be said
    grid = figures.verdicts(grid_rows, collections.defaultdict(lambda: Scene(scene, length, False, False)))
    facts = conditions(found, table, grid_table, program)
    lines = pages.summary(found.diagram, table, missing)
    name = f'{scene}.svg'
    if plots and any(error > 0.0 for same in runs[scene].values() for run in same if run.outcome == 'ok'
                     for error in run.errors.values()):
        from . import plots as drawings
        drawings.diagram(scene, runs[scene], drawings.styles(ordered(runs)), folder / name)
    else:
        name = None
    sections = sections_of(runs, grid, length, found.diagram.duration)
    write_markdown(folder / 'summary.md', scene, lines, facts, name, sections)
    write_html(folder / 'index.html', scene, lines, facts, name, sections)
    return lines


# title, text, header and lines of a table, CSS classes of the lines, and HTML that follows
Section = collections.namedtuple('Section', 'title text header lines classes body')


def sections_of(runs, grid, length, duration):
    found = []
    if any(not figures.is_ours(name) for name in ordered(runs)):
        compared = figures.comparison(runs)
        lines, classes = report_pages.comparison_lines(compared)
        found.append(Section('Run time to an error', ' '.join(report_pages.judgement(compared)),
                             report_pages.HEADER, lines, classes, ''))
    found.append(Section('All contestants', 'Least run time [µs/s] to each error. ' + report_pages.JUDGED_BY,
                         report_pages.CONTESTANT_HEADER, report_pages.contestant_lines(runs), None, ''))
    in_grid = ordered(grid)
    header, lines = report_pages.count_lines(figures.counts(grid), in_grid)
    text = f'{len(grid)} cases; the size L of the scene is {length:.3g} m. ' + ' '.join(
        report_pages.exploded_of(grid, name) for name in in_grid)
    scenes = collections.defaultdict(lambda: Scene('', length, False, False))
    found.append(Section('Stability', text, header, lines, None,
                         report_pages.grid_body(grid, scenes, in_grid, f'{duration:g} s')))
    return found


def write_markdown(path, scene, lines, facts, plot, sections):
    parts = [f'# {scene}: error against run time\n', '\n'.join(f'- {line}' for line in (*lines, *facts)) + '\n']
    if plot:
        parts.append(f'![error against run time]({plot})\n')
    for each in sections:
        parts += [f'## {each.title}\n', each.text + '\n', report_pages.markdown_table(each.header, each.lines)]
    path.write_text('\n'.join(parts))


def write_html(path, scene, lines, facts, plot, sections):
    body = ['<ul>', *(f'<li>{html.escape(line)}</li>' for line in (*lines, *facts)), '</ul>']
    if plot:
        body.append(f'<p>{report_pages.FRONT_TEXT}</p><img src="{html.escape(plot)}" alt="error against run time">')
    for each in sections:
        body += [f'<h2>{each.title}</h2><p>{html.escape(each.text)}</p>',
                 report_pages.table(each.header, each.lines, each.classes), each.body]
    path.write_text(report_pages.page(f'{scene}: error against run time', '\n'.join(body)))
