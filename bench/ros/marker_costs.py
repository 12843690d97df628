#!/usr/bin/env python3
"""What markers cost, beside the serialisation of the same message by roscpp.

Counts with valgrind the instructions of 100 rounds of messages, two simulated seconds: what it takes to find
the markers, and what it takes to serialise a MarkerArray that has the same ones.

    marker_costs.py PATH/TO/constraint_sim_marker_costs [SCENE.yaml ...]   all shipped scenes where none is named
    marker_costs.py PATH/TO/constraint_sim_marker_costs --check SCENE...   fails where to find them takes more than
                                                                           twice what it takes to serialise them
"""
import argparse
import os
import pathlib
import re
import subprocess
import sys

SCENES = pathlib.Path(__file__).resolve().parents[2] / 'config/scenes'
ROUNDS = 100
MOST = 2.0


def instructions(program, scene, what):
    # symbols of libraries are looked up before anything is counted that differs
    run = subprocess.run(['valgrind', '--tool=callgrind', '--callgrind-out-file=/dev/null', program, scene, what,
                          str(ROUNDS)], check=True, capture_output=True, text=True,
                         env=dict(os.environ, LD_BIND_NOW='1'))
    return int(re.search(r'Collected : (\d+)', run.stderr).group(1)), run.stdout.split()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('program')
    parser.add_argument('scenes', nargs='*', default=sorted(map(str, SCENES.glob('*.yaml'))))
    parser.add_argument('--check', action='store_true', help='fail where to find them takes more than twice')
    arguments = parser.parse_args()
    too_many = []
    print('| scene | markers a round | instructions to find them | to serialise them | first of the second |\n'
          '| --- | ---: | ---: | ---: | ---: |')
    for scene in arguments.scenes:
        counts = {what: instructions(arguments.program, scene, what)
                  for what in ('nothing', 'update', 'copy', 'serialise')}
        sent = int(counts['serialise'][1][0]) / ROUNDS
        found = (counts['update'][0] - counts['nothing'][0]) / ROUNDS
        serialised = (counts['serialise'][0] - counts['copy'][0]) / ROUNDS
        ratio = found / serialised
        name = pathlib.Path(scene).stem
        print(f'| {name} | {sent:.1f} | {found:.0f} | {serialised:.0f} | {ratio:.2f} |', flush=True)
        if ratio > MOST:
            too_many.append(name)
    if arguments.check and too_many:
        sys.exit('marker_costs: more than twice in ' + ', '.join(too_many))


if __name__ == '__main__':
    main()
