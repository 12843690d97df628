#!/usr/bin/env python3
"""Writes one problem of the report as a study of constraint_sim_sweep: its scene, the reference that is
independent of this engine, and the part of the report's grid that concerns it.

  bench/report/export_study.py grid four_bar_1 --programs build/report --output FOLDER
  constraint_sim_sweep FOLDER/four_bar_1.yaml --peers build/report

The contestants of the grid are those of the report, by its programs. In `diagrams` those of this engine whose
knob is a tolerance are methods of the study, with the tolerances of `constraint_sim_sweep --report`.
"""
import argparse
import csv
import pathlib
import subprocess
import sys

import numpy as np
import yaml

import studies
from constraint_sim.sweep import figures, peers, report
from constraint_sim.sweep.child import COMPONENTS

OURS = 'constraint_sim_report_engine'


def scene_of(program, problem):
    """Returns (text, facts by name, measured bodies)."""
    text = subprocess.run([program, 'save', '--problem', problem, '--variant', 'auto'], check=True, text=True,
                          stdout=subprocess.PIPE).stdout
    words = text.splitlines()[0].split()[1:]
    at = words.index('measured')
    return text, {name: float(value) for name, value in zip(words[:at:2], words[1:at:2])}, words[at + 1:]


def has_reference(program, problem):
    listing = subprocess.run([program, 'problems'], check=True, text=True, stdout=subprocess.PIPE).stdout
    facts = {line.split('\t')[0]: line.split('\t') for line in listing.splitlines()}
    if problem not in facts:
        raise SystemExit(f'export_study: there is no problem {problem!r}; there are ' + ', '.join(facts))
    return facts[problem][8] == '1'


def write_reference(program, problem, bodies, sample, folder):
    """Writes a reference in the runner's format; returns the file's name."""
    subprocess.run([program, 'references', folder, '--problem', problem], check=True, stdout=subprocess.DEVNULL)
    binary = folder / f'{problem}.reference'
    states = np.fromfile(binary).reshape(-1, len(bodies), len(COMPONENTS))
    binary.unlink()
    name = f'{problem}.reference.csv'
    with open(folder / name, 'w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(['time', 'body', *COMPONENTS])
        for number, state in enumerate(states):
            writer.writerows([repr(number * sample), body, *map(repr, map(float, row))]
                             for body, row in zip(bodies, state))
    return name


def methods_of(part, study, problem, labels):
    labels = [label for label in labels if studies.runs(study, problem, label)]
    if part == 'grid':
        return [{'name': label.replace(' ', '_'), 'peer': label} for label in labels]
    return (report.as_methods(report.ADAPTIVE, tolerances=report.TOLERANCES, time_steps=[report.SAMPLE])
            + report.as_methods(report.STEPPED)
            + [{'name': label.replace(' ', '_'), 'peer': label} for label in labels
               if not label.startswith(figures.OURS + ' ')])


def fits(tick, sample, duration):
    """Returns whether the duration is a whole number of ticks, and ticks and samples coincide."""
    ratio = max(sample / tick, tick / sample)
    return abs(round(duration / tick) - duration / tick) < 1e-9 * duration / tick and abs(round(ratio) - ratio) < 1e-6


def export(part, problem, programs, folder):
    """Writes the study and returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    ours, study = programs / OURS, studies.load(part)
    referenced = has_reference(ours, problem)
    text, facts, measured = scene_of(ours, problem)
    (folder / f'{problem}.scene.yaml').write_text(text)
    scale = facts['tick_scale'] if part == 'grid' else 1.0
    document = {
        'scene': f'{problem}.scene.yaml', 'duration': facts['duration'],
        'methods': methods_of(part, study, problem, peers.found_in(programs)),
        'time_steps': [scale * tick for tick in study.time_steps
                       if fits(scale * tick, facts['sample'], facts['duration'])],
        'outputs': {'every': facts['sample'], **({'bodies': measured} if measured else {})},
        'rounds': study.rounds, 'time_limit': study.time_limit}
    if referenced:
        bodies = [body['name'] for body in yaml.safe_load(text)['bodies']]
        document['reference'] = {'csv': write_reference(ours, problem, bodies, facts['sample'], folder)}
    path = folder / f'{problem}.yaml'
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('part', choices=('diagrams', 'grid'))
    parser.add_argument('problem')
    parser.add_argument('--programs', type=pathlib.Path, default=pathlib.Path('build/report'))
    parser.add_argument('--output', type=pathlib.Path, required=True)
    options = parser.parse_args()
    print(export(options.part, options.problem, options.programs, options.output))


if __name__ == '__main__':
    sys.exit(main())
