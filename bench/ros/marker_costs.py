#!/usr/bin/env python3
"""What markers cost while somebody listens, beside the serialisation of the same message by roscpp.

Counts with valgrind the instructions of 100 rounds of messages, two simulated seconds: what it takes to find
the markers, to find and serialise them as the node does, and what roscpp takes to serialise a
visualization_msgs/MarkerArray that has the same ones. Counts do not depend on what else the machine does.

    marker_costs.py PATH/TO/constraint_sim_marker_costs [SCENE.yaml ...]   all shipped scenes where none is named
    marker_costs.py PATH/TO/constraint_sim_marker_costs --check [SCENE...] fails where the node takes more than
                                                                           twice what the serialisation takes
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
    parser.add_argument('--check', action='store_true', help='fail where all of it takes more than twice the serialisation')
    arguments = parser.parse_args()
    too_many = []
    print('| scene | markers a round | instructions to find them | to find and serialise them '
          '| to serialise a MarkerArray | second of the third |\n| --- | ---: | ---: | ---: | ---: | ---: |')
    for scene in arguments.scenes:
        counts, output = {}, {}
        for what in ('nothing', 'update', 'publish', 'copy', 'serialise'):
            counts[what], output[what] = instructions(arguments.program, scene, what)
        name = pathlib.Path(scene).stem
        if output['publish'] != output['serialise']:
            sys.exit(f'marker_costs: {name}: not the same messages: {output}')
        found, published = ((counts[what] - counts['nothing']) / ROUNDS for what in ('update', 'publish'))
        serialised = (counts['serialise'] - counts['copy']) / ROUNDS
        ratio = published / serialised
        print(f'| {name} | {int(output["publish"][0]) / ROUNDS:.1f} | {found:.0f} | {published:.0f} '
              f'| {serialised:.0f} | {ratio:.2f} |', flush=True)
        if ratio > MOST:
            too_many.append(name)
    if arguments.check and too_many:
        sys.exit('marker_costs: more than twice in ' + ', '.join(too_many))


if __name__ == '__main__':
    main()
