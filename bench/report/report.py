#!/usr/bin/env python3
"""Measures error against run time, stability and scaling of this engine and others, and writes the report
to --output: index.html with all that is measured, summary.md with its pictures, the raw figures as CSV, and
in data/ the compressed figures from which --redraw makes summary.md again.

scripts/report calls this with what it has built. A run that was interrupted goes on where it
stopped, as long as its options, the commit and the engines' versions are the same; --fresh begins
anew. Problems and variants may come and go meanwhile.
"""
import argparse
import json
import math
import os
import pathlib
import platform
import re
import shutil
import subprocess
import sys
import time

import package_path  # noqa: F401
from constraint_sim.sweep import figures, report_pages

import cells
import kinds
import pages
import stored
import studies

SOURCES = pathlib.Path(__file__).parent
STUDIES = {part: studies.load(part) for part in studies.PARTS}
NOISE = 2.0  # more than the factor between the rounds of any setting
COUNTED = 'constraint_sim auto'  # contestant whose instructions are counted
PARTS = studies.PARTS
# Parts of the studies that a shorter report leaves out.
QUICK = {
    'problems': ('pendulum', 'double_pendulum', 'chain_10', 'chain_100', 'free_box',
                 'tumbling_pendulum', 'four_bar_10_loaded', 'net_8', 'heavy_chain_1e3', 'hinge_pair', 'slider_pair',
                 'arm_7', 'rope_and_wall', 'stick_slip', 'rocking_block', 'sliding_ball'),
    # one number of sweeps of each iterative solver, without variants that are nowhere the best of their
    # engine
    'leave_out': re.compile(r'_(10|200)$|^ode (step|quickstep_50)$|^mujoco (tendon_rk4|joint_euler)$'),
    'grid_ticks': (0.1, 1 / 60), 'grid_stride': 3, 'many': (), 'counts': (10, 100),
    'budget': 0.04, 'grid_budget': 0.02, 'many_budget': 0.0, 'sizes_budget': 0.015, 'shortest': 1e-3,
}
FULL = {'problems': None, 'leave_out': None, 'grid_ticks': STUDIES['grid'].time_steps, 'grid_stride': 1,
        'many': STUDIES['many'].scenes, 'counts': STUDIES['sizes'].counts, 'shortest': 0.0,
        'budget': STUDIES['diagrams'].time_limit, 'grid_budget': STUDIES['grid'].time_limit,
        'many_budget': STUDIES['many'].time_limit, 'sizes_budget': STUDIES['sizes'].time_limit}
TINY = {'problems': ('pendulum', 'oscillator'),
        'leave_out': re.compile('^(?!constraint_sim (auto|runge|sequential_impulses_10))'),
        'grid_ticks': (0.1, 1 / 30), 'grid_stride': 1, 'many': ('pendula_1000',), 'counts': (10, 30),
        'budget': 0.02, 'grid_budget': 0.02, 'many_budget': 0.02, 'sizes_budget': 5.0, 'shortest': 0.01}
SIZES = {'full': FULL, 'quick': QUICK, 'tiny': TINY}
BY_EVENTS = 'constraint_sim event_driven'  # equals `auto` where there are no contacts
TINY_GRID = ('pendulum_doubled', 'spring_1e+12', 'mass_nan', 'chain_load_1e+03')


def arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--programs', help='folder with constraint_sim_report_*')
    parser.add_argument('--output', help='folder for the report')
    parser.add_argument('--work', help='folder for references and unfinished runs')
    parser.add_argument('--page', help='folder that gets summary.md, its pictures and data/ too')
    parser.add_argument('--redraw', metavar='FOLDER',
                        help='measure nothing: write summary.md and its pictures from FOLDER/data')
    size = parser.add_mutually_exclusive_group()
    size.add_argument('--quick', action='store_true', help='some problems; a tenth of the time')
    size.add_argument('--tiny', action='store_true', help='seconds; for tests')
    parser.add_argument('--rounds', type=int, help='interleaved runs of each setting')
    parser.add_argument('--budget', type=float,
                        help='longest run in the diagrams [s]; all other budgets change in proportion')
    parser.add_argument('--only', choices=PARTS, action='append',
                        help='this part of the measurements; the others stay as they are')
    parser.add_argument('--fresh', action='store_true', help='begin anew')
    parser.add_argument('--perturb', type=float, default=0.0,
                        help='run everything a second time with gravity wrong by this share')
    parser.add_argument('--memory', type=int, default=4 << 30,
                        help='that a run may use [bytes], so that what grows without end is '
                             'stopped; 0: no limit')
    parser.add_argument('--commit', default='unknown')
    parser.add_argument('--date', default='', help='of the commit')
    options = parser.parse_args()
    missing = [f'--{name}' for name in ('programs', 'output', 'work') if not getattr(options, name)]
    if missing and not options.redraw:
        parser.error('without --redraw are needed: ' + ', '.join(missing))
    return options


def size_of(options):
    return next((name for name in ('quick', 'tiny') if getattr(options, name)), 'full')


def is_run(variant, problem):
    """Returns whether a variant runs a problem: contacts are event-driven where their events can be found one by
    one, in a problem with a reference."""
    return cells.label(variant) != BY_EVENTS or (
        problem.graded and problem.group in ('event', 'contact') and problem.name not in kinds.CONTACT_HEAPS)


def machine():
    """Returns the description of the machine."""
    compiler = subprocess.run(['c++', '--version'], text=True, stdout=subprocess.PIPE,
                              check=True).stdout.splitlines()[0]
    system = platform.freedesktop_os_release()['PRETTY_NAME'] \
        if hasattr(platform, 'freedesktop_os_release') else platform.platform()
    return {'processor': report_pages.processor(), 'system': system,
            'compiler': compiler + ', CMake Release (-O3)'}


def steps_of(shortest):
    return [step for step in STUDIES['diagrams'].time_steps if step >= shortest]


def values_of(variant, problem, shortest):
    """Returns the settings of a variant: tolerances, or the time steps of which a whole number fits the duration."""
    if variant.knob != 'tick':
        return variant.values
    return [step for step in steps_of(shortest)
            if abs(problem.duration / step - round(problem.duration / step)) < 1e-6 * problem.duration / step]


def is_continued(path, run, versions):
    """Returns whether the run described in the file is this one. Engines may have been added since."""
    if not path.exists():
        return False
    state = json.loads(path.read_text())
    before = state.get('versions', {})
    return state['run'] == run and all(before.get(name, version) == version
                                       for name, version in versions.items())


class Measurements:
    """Tables of a run, in its folder. Existing results are not measured again."""

    def __init__(self, options, size, work):
        self.options, self.size, self.work = options, size, work
        all_variants = cells.variants(options.programs)
        self.variants = [variant for variant in all_variants if not (
            size['leave_out'] and size['leave_out'].search(cells.label(variant)))]
        # sizes compare the fastest variants of engines, also where these are nowhere accurate enough
        self.sized_variants = self.variants if options.tiny else all_variants
        self.ours = self.variants[0].program
        self.problems = cells.problems(self.ours)
        versions = {variant.engine: variant.version for variant in all_variants}
        self.size_name = size_of(options)
        run = {'commit': options.commit, 'size': [self.size_name, options.rounds, options.budget,
                                                  options.perturb]}
        self.state_path = work / 'state.json'
        is_fresh = options.fresh or not is_continued(self.state_path, run, versions)
        state = {'run': run, 'versions': {}, 'taken': 0.0}
        if not is_fresh:
            state = json.loads(self.state_path.read_text())
        state['versions'].update(versions)
        self.state_path.write_text(json.dumps(state))
        if is_fresh:
            for name in ('instructions.json', 'micro.csv'):
                (work / name).unlink(missing_ok=True)
        self.tables = {part: cells.Table(work / f'{name}.csv', is_fresh) for part, name in (
            ('diagrams', 'cells'), ('grid', 'grid'), ('many', 'many'), ('sizes', 'sizes'))}
        self.own_errors = {}

    def graded(self):
        return [p.name for p in self.problems.values()
                if p.graded and (self.size['problems'] is None or p.name in self.size['problems'])]

    def in_grid(self):
        return [p.name for p in self.problems.values()
                if (not p.graded or p.name in STUDIES['grid'].scenes) and
                (not self.options.tiny or p.name in TINY_GRID)][::self.size['grid_stride']]

    def rounds(self, part):
        return self.options.rounds or STUDIES[part].rounds

    def batches(self):
        """Yields the batches of all requested parts."""
        size = self.size
        found = {
            'diagrams': [cells.Batch(1, name, variant,
                                     values_of(variant, self.problems[name], size['shortest']), False)
                         for name in self.graded() for variant in self.variants
                         if is_run(variant, self.problems[name])],
            'grid': [cells.Batch(1, name, variant, [tick * self.problems[name].tick_scale
                                                    for tick in size['grid_ticks']], True)
                     for name in self.in_grid() for variant in self.variants if cells.label(variant) != BY_EVENTS],
            'many': [cells.Batch(1, name, variant, STUDIES['many'].time_steps, True)
                     for name in size['many'] for variant in self.variants if cells.label(variant) != BY_EVENTS],
            'sizes': [cells.Batch(1, f'{kind}_{count}', variant,
                                  STUDIES['sizes'].time_steps, True)
                      for count in size['counts'] for kind in STUDIES['sizes'].scenes
                      for variant in self.sized_variants
                      if studies.runs(STUDIES['sizes'], kind, cells.label(variant))]}
        return {part: batches for part, batches in found.items()
                if part in (self.options.only or PARTS)}

    def measure(self):
        start = time.monotonic()
        try:
            self.measure_all()
        finally:
            state = json.loads(self.state_path.read_text())
            state['taken'] += time.monotonic() - start
            self.state_path.write_text(json.dumps(state))
        return state['taken']

    def measure_all(self):
        options, size, batches = self.options, self.size, self.batches()
        wrong = [batch._replace(round=0) for batch in batches.get('diagrams', [])
                 if options.perturb and batch.variant.engine == 'constraint_sim']
        used = dict.fromkeys(batch.problem for part in batches for batch in batches[part]
                             if batch.problem in self.problems and
                             self.problems[batch.problem].has_reference)
        progress = cells.ProgressBar(
            len(used) + len(wrong) + sum(len(batches[part]) * (1 if part == 'grid' else self.rounds(part))
                                         for part in batches))
        references = self.work / 'references'
        self.own_errors = cells.make_references(
            self.ours, references, list(used),
            [SOURCES / 'references.cpp', SOURCES / 'problem.cpp', *(SOURCES / 'problems').glob('*')],
            progress)
        common = {'references': references, 'memory': options.memory, 'perturbation': 0.0}
        if 'diagrams' in batches:
            self.interleaved('diagrams', [batches['diagrams']], progress, budget=size['budget'],
                             repeats=5, **common)
            cells.run_all('perturbed', wrong, self.tables['diagrams'], 1, progress,
                          budget=size['budget'], repeats=5, **{**common, 'perturbation': options.perturb})
        if 'grid' in batches:
            cells.run_all('grid', batches['grid'], self.tables['grid'], os.cpu_count(), progress,
                          budget=size['grid_budget'], repeats=1, **common)
        if 'many' in batches:
            self.interleaved('many', [batches['many']], progress, budget=size['many_budget'],
                             repeats=1, **common)
        if 'sizes' in batches:
            self.interleaved('sizes', [[batch for batch in batches['sizes']
                                        if batch.problem.endswith(f'_{count}')]
                                       for count in size['counts']], progress,
                             budget=size['sizes_budget'], repeats=5, **common)
            self.count_instructions()

    def interleaved(self, part, stages, progress, budget, **settings):
        """Runs all rounds; batches that failed in one stage are left out of later ones, and runs that cannot be on
        the front of their engine out of later rounds."""
        table, lost = self.tables[part], set()
        for batches in stages:
            cells.run_all(f'{part}, round 1', [
                batch._replace(values=[]) if self.line_of(batch) in lost else batch
                for batch in batches], table, 1, progress, budget=budget, **settings)
            ended = {(row['problem'], row['contestant']): row['outcome'] for row in table.rows()}
            lost |= {self.line_of(batch) for batch in batches
                     if ended.get((batch.problem, cells.label(batch.variant))) != 'ok'}
        # diagrams show only the front of each engine
        again = figures.contenders(table.rows(), NOISE if part == 'diagrams' else math.inf)
        for number in range(2, self.rounds(part) + 1):
            cells.repeat(number, [batch for batches in stages for batch in batches], again, table, progress,
                         budget=2.0 * budget, **settings)

    @staticmethod
    def line_of(batch):
        """Returns the kind of scene and the contestant, for any size."""
        return batch.problem.rsplit('_', 1)[0], cells.label(batch.variant)

    def count_instructions(self):
        """Counts the instructions of a step of this engine in the scenes that it ran, where valgrind is available."""
        path = self.work / 'instructions.json'
        counted = json.loads(path.read_text()) if path.exists() else {}
        names = sorted({row['problem'] for row in self.tables['sizes'].rows() if row['contestant'] == COUNTED and
                        f'{COUNTED} {row["problem"]}' not in counted})
        if self.options.tiny or not shutil.which('valgrind'):
            names = []

        def count(problem):
            counted[f'{COUNTED} {problem}'] = instructions(self.ours, COUNTED.split()[1], problem)

        cells.finish(os.cpu_count(), count, names)
        path.write_text(json.dumps(counted))

    def rows(self, part):
        """Returns rows without removed problems and variants."""
        known = {cells.label(variant) for variant in self.sized_variants}
        return [row for row in self.tables[part].rows()
                if row['contestant'].replace(' perturbed', '') in known and
                (part == 'sizes' or row['problem'] in self.problems)]


def instructions(program, variant, problem):
    ticks = 2
    run = subprocess.run(
        ['valgrind', '--tool=callgrind', '--callgrind-out-file=/dev/null',
         '--toggle-collect=*counted_ticks*', program, 'ticks', '--problem', problem, '--variant',
         variant, '--values', str(STUDIES['sizes'].time_steps[0]), '--repeats', str(ticks)],
        check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return int(re.search(r'Collected : (\d+)', run.stderr).group(1)) // ticks


def scene_texts(program):
    """Returns (title of the kind, name of the problem, scene as YAML) of the scenes that the page shows."""
    return [(kind.title, name, cells.output_of(program, 'save', '--problem', name, '--variant', 'auto'))
            for kind in kinds.KINDS for name in kind.scenes]


def facts_of(measurements, size, options, taken, runs):
    """Returns the conditions of a run, as runs.json has them."""
    variants = measurements.variants
    known = {path.stem for path in (SOURCES / 'peers').glob('*.cpp')}
    present = {variant.program.name.replace('constraint_sim_report_', '') for variant in variants}
    steps = steps_of(size['shortest'])
    return {'commit': options.commit, 'date': options.date, 'size': measurements.size_name, 'covers': '',
            'minutes': round(taken / 60.0, 1), 'rounds': measurements.rounds('diagrams'),
            'noise': NOISE,
            'budgets': {'diagrams': size['budget'], 'grid': size['grid_budget'], 'many': size['many_budget'],
                        'sizes': size['sizes_budget']},
            'time_steps': [steps[0], steps[-1]],
            'engines': {variant.engine: variant.version for variant in variants if variant.engine != figures.OURS},
            'absent': sorted(known - present), **machine(),
            'spread': [None if math.isnan(value) else round(value, 3) for value in figures.spread(runs)]}


def stored_of(measurements, rows, sizes, facts, runs):
    """Returns the figures of the page."""
    problems = measurements.problems
    grid = figures.verdicts(rows['grid'], problems)
    return stored.Stored([facts], stored.fronts_of(runs), stored.stability_of(grid),
                         stored.many_of(figures.runs_of(rows['many'])), sizes,
                         stored.problems_of(problems, measurements.own_errors, set(runs) | set(grid)))


def write_page(folder, page, scenes):
    """Writes the figures of the page, and the page from what was written; returns its blocks."""
    stored.write(folder / 'data', page)
    return pages.write(folder, stored.read(folder / 'data'), scenes)


def main():
    options = arguments()
    if options.redraw:
        folder = pathlib.Path(options.redraw)
        pages.write(folder, stored.read(folder / 'data'))
        print(f'report: {folder}/summary.md')
        return
    size = dict(SIZES[size_of(options)])
    if options.budget:
        share = options.budget / size['budget']
        size.update((name, share * size[name]) for name in size if name.endswith('budget'))
    work, output = pathlib.Path(options.work), pathlib.Path(options.output)
    work.mkdir(parents=True, exist_ok=True)
    output.mkdir(parents=True, exist_ok=True)
    measurements = Measurements(options, size, work)
    taken = measurements.measure()
    micro, benchmark = work / 'micro.csv', pathlib.Path(options.programs) / 'constraint_sim_micro'
    if size_of(options) != 'tiny' and not micro.exists() and benchmark.exists():
        micro.write_text(cells.output_of(
            benchmark, '--benchmark_format=csv', '--benchmark_min_time=0.02', '--benchmark_repetitions=5',
            '--benchmark_report_aggregates_only=true'))
    tables = measurements.tables
    for path in [table.path for part, table in tables.items() if table.done and part != 'sizes'] + [micro]:
        if path.exists():
            shutil.copy(path, output / path.name)
    counted = json.loads(path.read_text()) if (path := work / 'instructions.json').exists() else {}
    rows = {part: measurements.rows(part) for part in PARTS}
    sizes = figures.scaling(figures.runs_of(rows.pop('sizes')), counted)
    runs = figures.runs_of(rows['diagrams'])
    page = stored_of(measurements, rows, sizes, facts_of(measurements, size, options, taken, runs), runs)
    scenes = scene_texts(measurements.ours)
    blocks = write_page(output, page, scenes)
    pages.write_details(output, blocks, rows, sizes, measurements.problems, measurements.own_errors, size['budget'])
    if options.page:
        write_page(pathlib.Path(options.page), page, scenes)
        print(f'report: {options.page}/summary.md')
    print(f'report: {output}/index.html, {output}/summary.md; measured in {taken / 60.0:.1f} minutes')


if __name__ == '__main__':
    try:
        main()
    except KeyboardInterrupt:
        sys.exit('report: interrupted; the same command goes on from here')
