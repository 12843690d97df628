#!/usr/bin/env python3
"""Prints a digest of the bits of all positions, orientations and velocities after some hundred ticks of each
shipped scene, equal with every compiler and on every machine.

    bench/digests.py build/engine/constraint_sim_run            prints them
    bench/digests.py PROGRAM --check bench/digests.csv          fails where one differs
    bench/digests.py PROGRAM --update bench/digests.csv
    bench/digests.py PROGRAM --against OTHER            differences of positions to another program
"""
import argparse
import csv
import hashlib
import json
import pathlib
import subprocess
import sys
import tempfile

SCENES = pathlib.Path(__file__).resolve().parent.parent / 'config/scenes'
TICKS = 300
METHODS = ('auto', 'energy_momentum', 'event_driven', 'sequential_impulses', 'time_stepping')


def run(program, scene, method, folder):
    """Returns the bodies of the report."""
    text = scene.read_text()
    tick = next((float(line.split('time_step:')[1].split('#')[0].split(',')[0].strip(' }'))
                 for line in text.splitlines() if 'time_step:' in line), 0.01)
    report = folder / 'report.json'
    done = subprocess.run([program, scene, '--duration', repr(TICKS * tick), '--method', method,
                           '--report', report], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, check=False)
    if done.returncode not in (0, 4):  # 4: unclosed errors are reported, and their bits are compared too
        raise SystemExit(f'digests: {scene.stem} by {method} ended with {done.returncode}:\n{done.stdout}')
    return json.loads(report.read_text())['bodies']


def digest(program, scene, method, folder):
    bodies = run(program, scene, method, folder)
    return hashlib.sha256(json.dumps(bodies, sort_keys=True).encode()).hexdigest()[:16]


def difference(program, other, scene, method, folder):
    """Returns the largest difference of a coordinate of a position [m]."""
    a, b = (run(of, scene, method, folder) for of in (program, other))
    return max(abs(x - y) for name in a for x, y in zip(a[name]['position'], b[name]['position']))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('program')
    parser.add_argument('--check', type=pathlib.Path)
    parser.add_argument('--update', type=pathlib.Path)
    parser.add_argument('--against')
    options = parser.parse_args()
    if options.against:
        with tempfile.TemporaryDirectory() as folder:
            for scene in sorted(SCENES.glob('*.yaml')):
                off = [difference(options.program, options.against, scene, method, pathlib.Path(folder))
                       for method in METHODS]
                print(f'{scene.stem:20s}', *(f'{method} {value:.1e}' for method, value in zip(METHODS, off)))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        found = {(scene.stem, method): digest(options.program, scene, method, pathlib.Path(folder))
                 for scene in sorted(SCENES.glob('*.yaml')) for method in METHODS}
    if options.update:
        with options.update.open('w', newline='') as file:
            csv.writer(file, lineterminator='\n').writerows(
                [('scene', 'method', 'digest')] + [(*key, value) for key, value in found.items()])
        return 0
    known = {}
    if options.check:
        with options.check.open(newline='') as file:
            known = {(row['scene'], row['method']): row['digest'] for row in csv.DictReader(file)}
    different = 0
    for key, value in found.items():
        mark = ''
        if options.check and known.get(key) != value:
            mark = f'  not {known.get(key)}'
            different += 1
        if mark or not options.check:
            print(f'{key[0]:20s} {key[1]:20s} {value}{mark}')
    if options.check and set(known) != set(found):
        raise SystemExit('digests: scenes or methods are not those of ' + str(options.check))
    if different:
        raise SystemExit(f'digests: {different} of {len(found)} are not those of {options.check}')
    if options.check:
        print(f'all {len(found)} digests are those of {options.check}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
