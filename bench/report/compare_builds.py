#!/usr/bin/env python3
"""Compares the run times of two builds of this engine for the report's quick problems.

    compare_builds.py OLD NEW [--count] [--rounds 3] [--variant V ...] [--problem P ...]

OLD and NEW are constraint_sim_report_engine of two commits. Each problem, variant and value is run
by both in turn, in alternating rounds, and the smallest run time of each is compared; or, with
--count, the instructions of a tick as callgrind counts them, those of libraries included, which
other work on the machine does not change. Prints a line for each case that both completed, then
medians of the ratio NEW / OLD for each variant and for all.
"""
import argparse
import collections
import csv
import io
import pathlib
import re
import statistics
import subprocess
import sys

PROBLEMS = ('pendulum', 'double_pendulum', 'chain_10', 'chain_100', 'free_box', 'tumbling_pendulum',
            'four_bar_10_loaded', 'heavy_chain_1e3', 'sliding_ball')
VARIANTS = {  # values of each variant, coarse and fine
    'auto': ('1e-4', '1e-8'),
    'runge_kutta_order_8': ('0.016666666666666666', '0.004'),
    'runge_kutta_order_5': ('0.016666666666666666', '0.004'),
    'energy_momentum': ('0.016666666666666666', '0.004'),
    'sequential_impulses_50': ('0.016666666666666666', '0.004'),
}


def run(program, folder, problem, variant, values, budget):
    """Returns {value: µs per simulated second} of the successful runs."""
    header = subprocess.run([program, 'header'], check=True, capture_output=True, text=True).stdout
    done = subprocess.run([program, 'run', folder, '--problem', problem, '--variant', variant,
                           '--budget', str(budget), '--repeats', '9', '--values', *values],
                          capture_output=True, text=True)
    lines = [line for line in done.stdout.splitlines() if not line.startswith('begin ')]
    found = {}
    for row in csv.DictReader(io.StringIO(header + '\n'.join(lines))):
        if row['outcome'] == 'ok':
            found[row['value']] = float(row['run_time'])
    return found


def instructions(program, problem, variant, tick):
    """Returns the instructions of a tick, averaged between the 20th and the 60th."""
    counts = []
    for ticks in ('20', '60'):
        done = subprocess.run(['valgrind', '--tool=callgrind', '--callgrind-out-file=/dev/null', program,
                               'ticks', '--problem', problem, '--variant', variant, '--values', tick,
                               '--repeats', ticks], check=True, capture_output=True, text=True)
        counts.append(int(re.search(r'refs:\s+([\d,]+)', done.stderr)[1].replace(',', '')))
    return (counts[1] - counts[0]) / 40


def compare_counts(options, problem, variant, note):
    tick = VARIANTS[variant][-1] if variant != 'auto' else '0.01'
    note(problem, variant, tick, instructions(options.old, problem, variant, tick),
         instructions(options.new, problem, variant, tick))


def compare_times(options, problem, variant, note):
    folder = pathlib.Path(options.work)
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run([options.old, 'references', folder, '--problem', problem], check=True,
                   stdout=subprocess.DEVNULL)
    best = {'old': {}, 'new': {}}
    for i in range(options.rounds):
        for which in ('old', 'new') if i % 2 == 0 else ('new', 'old'):
            found = run(getattr(options, which), folder, problem, variant, VARIANTS[variant],
                        options.budget)
            for value, time in found.items():
                best[which][value] = min(best[which].get(value, time), time)
    for value in sorted(best['old'].keys() & best['new'].keys()):
        note(problem, variant, value, best['old'][value], best['new'][value])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('old')
    parser.add_argument('new')
    parser.add_argument('--count', action='store_true', help='instructions instead of time')
    parser.add_argument('--work', default='build/compare', help='for references')
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--budget', type=float, default=1.0, help='longest run [s]')
    parser.add_argument('--problem', action='append')
    parser.add_argument('--variant', action='append', choices=VARIANTS)
    options = parser.parse_args()

    ratios = collections.defaultdict(list)

    def note(problem, variant, value, old, new):
        ratios[variant].append(new / old)
        print(f'{problem},{variant},{value},{old:.4g},{new:.4g},{new / old:.3f}', flush=True)

    print('problem,variant,value,old,new,ratio')
    for problem in options.problem or PROBLEMS:
        for variant in options.variant or VARIANTS:
            (compare_counts if options.count else compare_times)(options, problem, variant, note)
    if not ratios:
        sys.exit('no case was done by both')
    for variant, those in ratios.items():
        print(f'# {variant}: median {statistics.median(those):.3f} of {len(those)}, '
              f'{min(those):.3f} to {max(those):.3f}')
    everything = sum(ratios.values(), [])
    print(f'# all: median {statistics.median(everything):.3f} of {len(everything)}')


if __name__ == '__main__':
    main()
