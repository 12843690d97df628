#!/usr/bin/env python3
"""Counts the instructions of a step with an edit before it, with valgrind: in a world of 1000 pendula, and of
an arm of seven hinges whose motors are set in each step, without and with limits and friction.

Usage: edit_instructions.py PATH/TO/constraint_sim_edit_costs
"""
import re
import subprocess
import sys

PENDULA = {'none': 'no edit', 'motor': '`set_motor` on one pendulum', 'state': '`set_state` of one bob',
           'break': 'the rod of one broken', 'add': 'a body added',
           'all': '`set_options`, which restarts all islands'}
ARM = {'arm': 'no edit', 'arm_forces': '`force` of each motor', 'arm_servos': '`position` of each servo',
       'arm_rates': '`bias` of each motor', 'arm_wrench': 'a wrench that stays',
       'arm_wrenches': 'another wrench'}


def instructions(program, edit, steps):
    run = subprocess.run(['valgrind', '--tool=callgrind', '--callgrind-out-file=/dev/null', program, edit,
                          str(steps)], check=True, capture_output=True, text=True)
    return int(re.search(r'Collected : (\d+)', run.stderr).group(1))


def a_step(program, edit, steps):
    return (instructions(program, edit, steps) - instructions(program, edit, 0)) / steps


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    program = sys.argv[1]
    print('| before each step | million instructions |\n| --- | ---: |')
    for edit, what in PENDULA.items():
        print(f'| {what} | {a_step(program, edit, 10) / 1e6:.2f} |', flush=True)
    print('\n| before each step | thousand instructions | with limits and friction |\n| --- | ---: | ---: |')
    for edit, what in ARM.items():
        counts = [a_step(program, prefix + edit, 100) / 1e3 for prefix in ('', 'limited_')]
        print(f'| {what} | {counts[0]:.0f} | {counts[1]:.0f} |', flush=True)


if __name__ == '__main__':
    main()
