#!/usr/bin/env python3
"""A digest of the bits of all positions, orientations and velocities after some hundred ticks of each
shipped scene, the same with every compiler and on every machine.

    bench/digests.py build/engine/constraint_sim_run            prints them
    bench/digests.py PROGRAM --check bench/digests.csv          fails where one is another
    bench/digests.py PROGRAM --update bench/digests.csv
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
METHODS = ('auto', 'energy_momentum', 'event_driven', 'sequential_impulses')


def digest(program, scene, method, folder):
    text = scene.read_text()
    tick = next((float(line.split('time_step:')[1].split('#')[0].split(',')[0].strip(' }'))
                 for line in text.splitlines() if 'time_step:' in line), 0.01)
    report = folder / 'report.json'
    done = subprocess.run([program, scene, '--duration', repr(TICKS * tick), '--method', method,
                           '--report', report], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, check=False)
    if done.returncode not in (0, 4):  # 4: errors that are not closed are told, and are bits too
        raise SystemExit(f'digests: {scene.stem} by {method} ended with {done.returncode}:\n{done.stdout}')
    bodies = json.loads(report.read_text())['bodies']
    return hashlib.sha256(json.dumps(bodies, sort_keys=True).encode()).hexdigest()[:16]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('program')
    parser.add_argument('--check', type=pathlib.Path)
    parser.add_argument('--update', type=pathlib.Path)
    options = parser.parse_args()
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
        print(f'{key[0]:20s} {key[1]:20s} {value}{mark}')
    if options.check and set(known) != set(found):
        raise SystemExit('digests: scenes or methods are not those of ' + str(options.check))
    if different:
        raise SystemExit(f'digests: {different} of {len(found)} are not those of {options.check}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
