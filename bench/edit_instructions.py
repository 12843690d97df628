#!/usr/bin/env python3
"""Counts the instructions of an edit before a step in a world of 1000 pendula, with valgrind.

Usage: edit_instructions.py PATH/TO/constraint_sim_edit_costs
"""
import re
import subprocess
import sys

STEPS = 10
EDITS = {'none': 'a step alone', 'motor': '`set_motor` on one pendulum', 'state': '`set_state` of one bob',
         'break': 'the rod of one broken', 'add': 'a body added', 'all': '`set_options`'}


def instructions(program, edit, steps):
    run = subprocess.run(['valgrind', '--tool=callgrind', '--callgrind-out-file=/dev/null', program, edit,
                          str(steps)], check=True, capture_output=True, text=True)
    return int(re.search(r'Collected : (\d+)', run.stderr).group(1))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    program = sys.argv[1]
    before = instructions(program, 'none', 0)
    alone = None
    print('| before each step | million instructions a step | of a step alone |\n| --- | ---: | ---: |')
    for edit, what in EDITS.items():
        count = (instructions(program, edit, STEPS) - before) / STEPS
        alone = alone or count
        print(f'| {what} | {count / 1e6:.2f} | {count / alone:.2f} |', flush=True)


if __name__ == '__main__':
    main()
