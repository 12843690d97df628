#!/usr/bin/env python3
"""Compares the cost of markers with a subscriber to the serialization of that message by roscpp.

Counts with valgrind the instructions of 100 rounds of messages, two simulated seconds: to update
the markers, to serialize them as the node does, and for roscpp to serialize a
visualization_msgs/MarkerArray with these markers. Counts do not depend on other work of the machine.

    marker_costs.py PATH/TO/constraint_sim_marker_costs [SCENE.yaml ...]           all shipped scenes where none is named
    marker_costs.py --check PATH/TO/constraint_sim_marker_costs [SCENE.yaml ...]   fails where the node takes more
                                                                                   than 2.5 times the serialisation
"""
import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile

SCENES = pathlib.Path(__file__).resolve().parents[2] / 'config/scenes'
ROUNDS = 100
FUNCTIONS = ('find_markers', 'serialise_markers', 'serialise_array')
MOST = 2.5  # arrows of friction: each is the sum of several contacts, and has ten points in the message


def measured(program, scene):
    """Returns instructions by function, callees included, and the numbers that the program prints."""
    with tempfile.NamedTemporaryFile() as profile:
        # symbols of libraries are resolved before, not within the counted functions
        output = subprocess.run(['valgrind', '--tool=callgrind', '--callgrind-out-file=' + profile.name, program,
                                 scene, str(ROUNDS)], check=True, capture_output=True, text=True,
                                env=dict(os.environ, LD_BIND_NOW='1')).stdout
        listing = subprocess.run(['callgrind_annotate', '--inclusive=yes', '--threshold=100', profile.name],
                                 check=True, capture_output=True, text=True).stdout
    counts = {}
    for function in FUNCTIONS:
        found = re.findall(r'([\d,]+) \([ \d.]+%\)  .*::' + function + r'\(', listing)
        if len(found) != 1:
            sys.exit(f'marker_costs: {function} is {len(found)} times in what callgrind found')
        counts[function] = int(found[0].replace(',', '')) / ROUNDS
    return counts, [int(word) for word in output.split()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('program')
    parser.add_argument('scenes', nargs='*', default=sorted(map(str, SCENES.glob('*.yaml'))))
    parser.add_argument('--check', action='store_true', help='fail where all of it takes more than 2.5 times the serialisation')
    arguments = parser.parse_args()
    too_many = []
    print('| scene | markers a round | instructions to find them | to find and serialise them '
          '| to serialise a MarkerArray | second of the third |\n| --- | ---: | ---: | ---: | ---: | ---: |')
    for scene in arguments.scenes:
        name = pathlib.Path(scene).stem
        counts, (markers, bytes_sent, bytes_of_array) = measured(arguments.program, scene)
        if bytes_sent != bytes_of_array:
            sys.exit(f'marker_costs: {name}: {bytes_sent} bytes of markers, {bytes_of_array} of arrays of them')
        found, written, serialised = (counts[function] for function in FUNCTIONS)
        ratio = (found + written) / serialised
        print(f'| {name} | {markers / ROUNDS:.1f} | {found:.0f} | {found + written:.0f} '
              f'| {serialised:.0f} | {ratio:.2f} |', flush=True)
        if ratio > MOST:
            too_many.append(name)
    if arguments.check and too_many:
        sys.exit(f'marker_costs: more than {MOST} times in ' + ', '.join(too_many))


if __name__ == '__main__':
    main()
