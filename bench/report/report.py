#!/usr/bin/env python3
"""Measures error against run time, stability and scaling of this engine and others, and writes the
report: an HTML page with plots, the raw figures as CSV, and a summary in Markdown.

scripts/report calls this with what it has built. A run that was interrupted goes on where it
stopped, as long as its options and the commit are the same; --fresh begins anew.
"""
import argparse
import csv
import json
import os
import pathlib
import platform
import re
import shutil
import subprocess
import sys
import time

import cells
import pages

SOURCES = pathlib.Path(__file__).parent
# multiples of 10 a second, since errors are sampled each 0.1 s
RATES = (10, 20, 30, 40, 60, 80, 120, 240, 500, 1000, 2000, 4000, 10000, 30000, 100000)
GRID_TICKS = (0.5, 0.1, 1 / 30, 1 / 60, 1 / 240, 1 / 1000)
# the stability grid also has the diagrams' problems that are stiff, singular or redundant
ALSO_IN_GRID = ('four_bar_1', 'four_bar_10', 'four_bar_1_loaded', 'four_bar_10_loaded', 'ring_12',
                'n_four_bar_2', 'net_8', 'block_sticks', 'bouncing')
QUICK = {
    'problems': ('pendulum', 'double_pendulum', 'chain_10', 'chain_100', 'free_box',
                 'tumbling_pendulum', 'four_bar_10_loaded', 'heavy_chain_1e3', 'sliding_ball'),
    # one number of sweeps of each iterative solver, and what is nowhere the best of its engine
    'leave_out': re.compile(r'_(10|200)$|^ode (step|quickstep_50)$|^mujoco (tendon_rk4|joint_euler)$'),
    'grid_ticks': (0.1, 1 / 60),
    'budget': 0.08, 'grid_budget': 0.03, 'most': 1000,
}
FULL = {'problems': None, 'leave_out': None, 'grid_ticks': GRID_TICKS, 'budget': 3.0,
        'grid_budget': 3.0, 'most': 100000}
TINY = {'problems': ('pendulum', 'oscillator'),
        'leave_out': re.compile('^(?!constraint_sim (auto|runge|sequential_impulses_10))'),
        'grid_ticks': (0.1, 1 / 30), 'budget': 0.02, 'grid_budget': 0.02, 'most': 100}
TINY_GRID = ('pendulum_doubled', 'spring_1e+12', 'mass_nan', 'chain_load_1e+03')


def arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--programs', required=True, help='folder with constraint_sim_report_*')
    parser.add_argument('--output', required=True, help='folder for the report')
    parser.add_argument('--work', required=True, help='folder for references and unfinished runs')
    size = parser.add_mutually_exclusive_group()
    size.add_argument('--quick', action='store_true', help='a few minutes')
    size.add_argument('--tiny', action='store_true', help='seconds; for tests')
    parser.add_argument('--rounds', type=int, default=5, help='interleaved runs of each setting')
    parser.add_argument('--budget', type=float, help='longest run [s]')
    parser.add_argument('--fresh', action='store_true', help='begin anew')
    parser.add_argument('--perturb', type=float, default=0.0,
                        help='run everything a second time with gravity wrong by this share')
    parser.add_argument('--memory', type=int, default=4 << 30,
                        help='that a run may use [bytes], so that what grows without end is '
                             'stopped; 0: no limit')
    parser.add_argument('--commit', default='unknown')
    return parser.parse_args()


def machine():
    """What the figures were measured on."""
    cpu = 'unknown processor'
    for line in pathlib.Path('/proc/cpuinfo').read_text().splitlines():
        if line.startswith('model name'):
            cpu = line.split(':')[1].strip()
            break
    compiler = subprocess.run(['c++', '--version'], text=True, stdout=subprocess.PIPE,
                              check=True).stdout.splitlines()[0]
    system = platform.freedesktop_os_release()['PRETTY_NAME'] \
        if hasattr(platform, 'freedesktop_os_release') else platform.platform()
    return {'processor': f'{cpu}, {os.cpu_count()} threads', 'system': system,
            'compiler': compiler + ', CMake Release (-O3)'}


def values_of(variant, most):
    if variant.knob == 'tick':
        return [1.0 / rate for rate in RATES if rate <= most]
    return variant.values


def measure(options, size, work, variants, problems):
    """Fills the two tables."""
    state_path = work / 'state.json'
    state = {'commit': options.commit, 'size': [options.quick, options.tiny, options.rounds,
                                                options.budget, options.perturb],
             'versions': sorted({f'{v.engine} {v.version} {v.name}' for v in variants})}
    is_fresh = options.fresh or not state_path.exists() or \
        json.loads(state_path.read_text())['run'] != state
    if is_fresh:
        state_path.write_text(json.dumps({'run': state, 'started': time.time()}))
        for name in ('scaling.csv', 'micro.csv'):
            (work / name).unlink(missing_ok=True)
    graded = [p.name for p in problems.values() if p.graded and
              (size['problems'] is None or p.name in size['problems'])]
    in_grid = [p.name for p in problems.values()
               if (not p.graded or p.name in ALSO_IN_GRID) and
               (not options.tiny or p.name in TINY_GRID)]
    ours = next(v.program for v in variants if v.engine == 'constraint_sim')
    sources = [SOURCES / 'references.cpp', SOURCES / 'problem.cpp',
               *(SOURCES / 'problems').glob('*')]
    references = work / 'references'
    own_errors = cells.make_references(
        ours, references, [name for name in [*graded, *in_grid] if problems[name].has_reference],
        sources)

    budget = options.budget or size['budget']
    common = {'references': references, 'repeats': 5, 'memory': options.memory}
    diagrams = cells.Table(work / 'cells.csv', is_fresh)
    first = [cells.Batch(1, name, variant, values_of(variant, size['most']), False)
             for name in graded for variant in variants]
    cells.run_all('round 1', first, diagrams, 1, budget=budget, perturbation=0.0, **common)
    worth = cells.worth_repeating(diagrams, first)
    for number in range(2, options.rounds + 1):
        again = [batch._replace(round=number, values=worth[cells.Table.key(batch).split(' ', 1)[1]])
                 for batch in first]
        cells.run_all(f'round {number}', [batch for batch in again if batch.values], diagrams, 1,
                      budget=2.0 * budget, perturbation=0.0, **common)
    if options.perturb:
        wrong = [batch._replace(round=0) for batch in first
                 if batch.variant.engine == 'constraint_sim']
        cells.run_all('perturbed', wrong, diagrams, 1, budget=budget, perturbation=options.perturb,
                      **common)

    grid = cells.Table(work / 'grid.csv', is_fresh)
    batches = [cells.Batch(1, name, variant,
                           [tick * problems[name].tick_scale for tick in size['grid_ticks']], True)
               for name in in_grid for variant in variants]
    common['repeats'] = 1
    cells.run_all('stability', batches, grid, os.cpu_count(), budget=size['grid_budget'],
                  perturbation=0.0, **common)
    state = json.loads(state_path.read_text())
    if 'taken' not in state:  # when pages alone are written anew, it stays
        state['taken'] = time.time() - state['started']
        state_path.write_text(json.dumps(state))
    return diagrams, grid, own_errors, state['taken']


def instructions(program, kind, count, steps):
    run = subprocess.run(
        ['valgrind', '--tool=callgrind', '--callgrind-out-file=/dev/null', program, kind, str(count),
         str(steps)], check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return int(re.search(r'Collected : (\d+)', run.stderr).group(1))


def measure_scaling(program, most, path):
    """The program's lines, with instructions of a step, counted by valgrind where it is there."""
    rows = list(csv.DictReader(cells.output_of(program, str(most)).splitlines()))
    most_counted, steps = 10000, 2
    can_count = shutil.which('valgrind')
    progress = cells.ProgressBar('scaling', len(rows))

    def count(row):
        row['instructions'] = 0
        if can_count and int(row['count']) <= most_counted:
            size = row['kind'], row['count']
            row['instructions'] = (instructions(program, *size, steps) -
                                   instructions(program, *size, 0)) // steps
        progress.step()

    cells.finish(os.cpu_count(), count, rows)
    with open(path, 'w', newline='') as file:
        writer = csv.DictWriter(file, list(pages.SCALING_COLUMNS),
                                lineterminator='\n')
        writer.writeheader()
        writer.writerows(rows)


def main():
    options = arguments()
    size = QUICK if options.quick else TINY if options.tiny else FULL
    work, output = pathlib.Path(options.work), pathlib.Path(options.output)
    work.mkdir(parents=True, exist_ok=True)
    output.mkdir(parents=True, exist_ok=True)
    variants = [variant for variant in cells.variants(options.programs)
                if not (size['leave_out'] and
                        size['leave_out'].search(f'{variant.engine} {variant.name}'))]
    problems = cells.problems(variants[0].program)
    diagrams, grid, own_errors, taken = measure(options, size, work, variants, problems)

    scaling, micro = work / 'scaling.csv', work / 'micro.csv'
    if not options.tiny and not scaling.exists():
        measure_scaling(pathlib.Path(options.programs) / 'constraint_sim_scaling',
                        1000 if options.quick else 100000, scaling)
    if not options.tiny and not micro.exists():
        micro.write_text(cells.output_of(
            pathlib.Path(options.programs) / 'constraint_sim_micro', '--benchmark_format=csv',
            '--benchmark_min_time=0.02', '--benchmark_repetitions=5',
            '--benchmark_report_aggregates_only=true'))
    for path in (diagrams.path, grid.path, scaling, micro):
        if path.exists():
            shutil.copy(path, output / path.name)
    known = {path.stem for path in (SOURCES / 'peers').glob('*.cpp')}
    present = {variant.program.name.replace('constraint_sim_report_', '') for variant in variants}
    facts = {**machine(), 'commit': options.commit, 'rounds': options.rounds,
             'budget': options.budget or size['budget'], 'grid_budget': size['grid_budget'],
             'kind': 'quick' if options.quick else 'tiny' if options.tiny else 'full',
             'absent': sorted(known - present), 'measured in': f'{taken / 60.0:.1f} min'}
    pages.write(output, diagrams.rows(), grid.rows(), problems, variants, own_errors, facts)
    print(f'report: {output}/index.html, {output}/summary.md')


if __name__ == '__main__':
    try:
        main()
    except KeyboardInterrupt:
        sys.exit('report: interrupted; the same command goes on from here')
