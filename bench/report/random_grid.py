#!/usr/bin/env python3
"""Runs random stiff and extreme scenes in this engine and others, and prints how often each holds.

A scene is a number: --seed 1 --scenes 100 are the scenes 1 to 100, and --only 57 is one of them again.
Equal numbers give equal scenes on every machine. Its class is drawn with equal chances:
  free bodies  1 to 3 tumbling bars
  chain        1 to 10 masses on rods or bars on ball joints, 70 % on the world, the others free
  springs      1 to 6 of these; the first is on a spring, half of the others are
  closed loop  3 to 8 corners of rods, with braces, or of bars; 30 % free rings
  limits       a slack rope, or a hinge or slider with limits; 0 to 3 bodies hang on it
  contacts     1 to 6 balls one above the other, the lowest a box in half of the scenes, at rest or thrown
  mixed        a chain with rope and springs that ends in a ball over a plane, 50 % closed, and a free ball
Five scales are drawn with equal density of their logarithm: in half of the scenes from the ordinary range, in
the others from the whole range, each scale for itself.
  scale                          ordinary          whole
  length [m]                     0.1 to 10         1e-6 to 1e6
  largest mass ratio             1 to 10           1 to 1e9
  stiffness of springs [N/m]     1 to 1e4          1 to 1e9
  step [s]                       1e-3 to 2e-2      1e-3 to 1
  largest angular rate [rad/s]   0.1 to 10         0.1 to 1e5
The lightest mass is 1e-3 to 1e3 kg; gravity is off in 20 % of the scenes without contacts; bars have cross
sections of 0.05 to 1 lengths; springs are stretched by up to 10 %; friction and restitution are 0 in half of the
scenes and 0 to 1 in the others. Initial velocities fit the joints. A scene lasts 1 s, and 20 steps at least.

Outcomes, from the states after every step, each quantity over a scale of its own:
  held            all within 1 %
  wrong, said     beyond it, and the engine said so: by a warning, or by an error figure of at least a tenth of it;
                  of other engines any message counts
  wrong, grown    beyond it, where the engine's estimate of the error alone is too small, and is enough with the
                  growth of a disturbance of the start, by which the motion amplifies any error
  wrong, silent   beyond it, without a word
  blew up, said; blew up, silent     a state that is not finite, or a quantity beyond its whole scale
  refused         an error, or an exception, instead of a result
  timed out       the steps took more processor time than --budget
  crashed         the process ended by a signal
  cannot          the engine, or its adapter here, cannot express the scene
Quantities: errors of joints and ropes over the length of the scene; excess over limits (radians, or over the length);
overlap over half of the smallest shape; rise of energy, without contacts, limits and friction any change, over the
energy at the start plus the work of gravity; change of linear and angular momentum of isolated scenes over the sums
of their parts; and the distance from a reference over length or path, or an angle in radians. The reference is this
engine with steps of 1/16 and 1/32 at tighter tolerances, as far as these two agree to 1e-6 of the length. It counts
as inaccurate only, as a motion may be sensitive. --no-reference judges by the other quantities alone, which do not
depend on any engine.
"""
import argparse
import collections
import os
import pathlib
import re
import resource
import signal
import subprocess
import tempfile

import cells

OUTCOMES = ('held', 'wrong, said', 'wrong, grown', 'wrong, silent', 'blew up, said', 'blew up, grown',
            'blew up, silent', 'refused', 'timed out', 'crashed', 'cannot')
LEFT_OUT = re.compile('^constraint_sim (?!auto)|_(10|200)$')  # methods by name, and numbers of sweeps
Result = collections.namedtuple('Result', 'outcome criterion amount time words')
GRACE = 10.0  # processor time beyond the budget for building, judging and one step that hangs [s]
MOST_WAIT = 50.0  # wall time over the limit of processor time
NO_FIGURES = ('', 'nan', 'nan')


def run(limit, memory, *command):
    """Returns exit status, standard output and standard error of a process with these limits of processor time [s]
    and memory [bytes; 0: none]."""
    def set_limits():
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if memory:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    try:
        done = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              preexec_fn=set_limits, timeout=MOST_WAIT * limit)
    except subprocess.TimeoutExpired:  # waits without using the processor
        return -signal.SIGXCPU, '', ''
    return done.returncode, done.stdout.decode(errors='replace'), done.stderr.decode(errors='replace')


def judged(variant, number, folder, budget, memory):
    """Runs a scene in an engine and returns the result."""
    status, output, messages = run(budget + GRACE, memory, variant.program, 'judge', folder, '--problem',
                                   f'random_{number}', '--variant', variant.name, '--budget', budget)
    lines = output.splitlines()
    found = [line for line in lines if line.startswith('judged\t')]
    printed = [line.strip() for line in messages.splitlines() + lines if line not in found and line.strip()]
    if not found:
        if status in (-signal.SIGXCPU, -signal.SIGKILL):
            return Result('timed out', *NO_FIGURES, 'within a step')
        return Result('crashed' if status < 0 else 'refused', *NO_FIGURES, (printed or [f'status {status}'])[-1])
    grade, criterion, amount, time, word, words = (found[0].split('\t')[1:] + [''] * 6)[:6]
    special = {'unsupported': 'cannot', 'refused': 'refused', 'too_slow': 'timed out', 'held': 'held'}
    if grade in special:
        return Result(special[grade], criterion, amount, time, words)
    if word == 'silent' and variant.engine != 'constraint_sim':
        word, words = ('said', printed[-1]) if printed else ('silent', '')
    return Result(f'{"wrong" if grade == "inaccurate" else grade}, {word}', criterion, amount, time, words)


def table(rows):
    """Returns a table of outcomes in Markdown from pairs of label and counts."""
    used = [outcome for outcome in OUTCOMES if any(counts[outcome] for _, counts in rows)]
    lines = [f'| | {" | ".join(used)} |', f'|---|{"---:|" * len(used)}']
    for label, counts in rows:
        lines.append(f'| {label} | {" | ".join(str(counts[outcome]) for outcome in used)} |')
    return '\n'.join(lines)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add('--seed', type=int, default=1, help='number of the first scene; default 1')
    add('--scenes', type=int, default=100, help='number of scenes; default 100')
    add('--only', type=int, metavar='SEED', help='runs this scene alone, with details, and prints its YAML')
    add('--engines', default='', metavar='REGEX', help='engines and variants; default: `auto` of this engine, and '
        'other engines without their smallest and largest numbers of sweeps')
    add('--budget', type=float, default=2.0, help='processor time of a scene in an engine [s]; default 2')
    add('--memory', type=int, default=4 << 30, help='most memory of a process [bytes]; 0: no limit; default 4 GiB')
    add('--no-reference', action='store_true', help='judges without finer steps of this engine')
    add('--details', action='store_true', help='prints each scene and engine')
    add('--programs', default='build/report', help='folder of the programs that scripts/report builds')
    add('--commit', default='unknown', help='commit, for the page')
    add('--output', metavar='FILE', help='writes a page in Markdown')
    options = parser.parse_args()
    if options.only is not None:
        options.seed, options.scenes, options.details = options.only, 1, True
    for name in ('seed', 'scenes'):
        if not 1 <= getattr(options, name) < 2**30:
            parser.error(f'--{name}: must be from 1 to {2**30 - 1}, got {getattr(options, name)}')
    if not options.budget > 0.0:
        parser.error(f'--budget: must be > 0, got {options.budget}')
    return options


def chosen(options):
    all_variants = cells.variants(options.programs)
    if options.engines:
        found = [variant for variant in all_variants if re.search(options.engines, cells.label(variant))]
    else:
        found = [variant for variant in all_variants if not LEFT_OUT.search(cells.label(variant))]
    if not all_variants or not found:
        raise SystemExit(f'random_grid: no engine in {options.programs} matches {options.engines!r}')
    return all_variants[0].program, found


def worst_of(result):
    """Returns the worst quantity of a run; of a run without states, such as one that timed out, its message."""
    if not result.criterion:
        return result.words or 'not judged'
    return f'{result.criterion} {result.amount} at {result.time} s: {result.words}'


def held_line(count, scenes):
    """Returns a sentence on the scenes that the default method and the best other contestant hold."""
    ours = [name for name in count if name == 'constraint_sim auto']
    peers = [name for name in count if not name.startswith('constraint_sim ')]
    def silent(name):
        return count[name]['wrong, silent'] + count[name]['blew up, silent']
    parts = [f'{name} holds {count[name]["held"]} of {scenes} scenes and is wrong without a word in {silent(name)}'
             for name in ours]
    if peers:
        best = max(peers, key=lambda name: count[name]['held'])
        parts.append(f'{best}, which holds most of the others, holds {count[best]["held"]}, is wrong without a word in '
                     f'{silent(best)} and cannot express {count[best]["cannot"]}')
    return '; '.join(parts) + '.'


def lines_of_ours(results, scenes):
    """Returns a line for each scene that this engine did not hold, the silent ones first."""
    lines = [(not result.outcome.endswith('silent'), number,
              f'| {number} | {scenes[number][0]} | {scenes[number][1]} | {result.outcome} | {worst_of(result)} |')
             for (number, name), result in results.items()
             if name == 'constraint_sim auto' and result.outcome != 'held']
    return [line for _, _, line in sorted(lines)]


def page(options, variants, results, scenes, referenced):
    """Returns the page."""
    names = [cells.label(variant) for variant in variants]
    count = {name: collections.Counter(results[number, name].outcome for number in scenes) for name in names}
    last = options.seed + options.scenes - 1
    versions = dict.fromkeys(f'{variant.engine} {variant.version}' for variant in variants)
    text = [
        '# Random stiff and extreme scenes', held_line(count, options.scenes),
        f'Scenes {options.seed} to {last}, commit {options.commit}, {options.budget:g} s of processor time a scene. '
        f'Engines: {", ".join(versions)}.',
        f'Command: `./scripts/report --random --seed {options.seed} --scenes {options.scenes} --budget '
        f'{options.budget:g}`. `./scripts/report --random --help` has the distribution of the scenes and the '
        'limits of the outcomes; `--random --only SEED` runs a scene again.',
        f'The reference, this engine in finer steps, covers more than half of the run in {referenced} of '
        f'{options.scenes} scenes. Steps, tolerances and numbers of sweeps are defaults of the engines; none is set '
        'for a scene. A time-out near the budget depends on the machine; all other outcomes repeat.',
        'Held: joints, limits, overlaps, energy, momentum and the reference are within 1 % of their scales. Wrong: one '
        'of these is beyond. Blew up: one other than the reference is beyond its whole scale, or a state is not '
        'finite. Said: the engine warned, or reported an error of this order. Grown: its estimate of the error '
        'explains the error only with the growth of disturbances that the motion itself has. Silent: neither a warning '
        'nor such an estimate. Cannot: the engine, or its adapter in `bench/report/peers`, cannot express the scene.',
        'Other engines are used as in the [report](summary.md). A message of theirs counts as said. The stiffness of '
        "Simbody's contacts is chosen for scenes of about a metre; its constraints and those of MuJoCo are what "
        'their settings for this report make them.',
        '## All scenes', table([(name, count[name]) for name in names])]
    for group in sorted({scene[0] for scene in scenes.values()}):
        within = [number for number in scenes if scenes[number][0] == group]
        text += [f'## {group.capitalize()}: {len(within)} scenes',
                 table([(name, collections.Counter(results[number, name].outcome for number in within))
                        for name in names])]
    lines = lines_of_ours(results, scenes)
    text += ['## Scenes that constraint_sim does not hold',
             '\n'.join(['| scene | class | size | outcome | worst quantity, over its scale |',
                        '|---|---|---|---|---|'] + lines) if lines else 'None.']
    return '\n\n'.join(text) + '\n'


def main():
    options = arguments()
    ours, variants = chosen(options)
    results, scenes, referenced = {}, {}, 0
    progress = cells.ProgressBar(options.scenes * len(variants))
    progress.title = 'random scenes'
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.seed, options.seed + options.scenes):
            problem = f'random_{number}'
            group, words = cells.output_of(ours, 'describe', '--problem', problem).strip().split('\t')
            scenes[number] = group, words
            reach = 'no reference'
            if not options.no_reference:
                _, output, _ = run(6.0 * options.budget + GRACE, options.memory, ours, 'refine', folder,
                                   '--problem', problem, '--budget', 2.0 * options.budget)
                match = re.search(r'refined (\d+) of (\d+)', output)
                if match:
                    reach = f'reference for {match.group(1)} of {match.group(2)} samples'
                    referenced += 2 * int(match.group(1)) > int(match.group(2))
            if options.details:
                print(f'{number} {group}: {words}; {reach}')
            for variant in variants:
                name = cells.label(variant)
                result = results[number, name] = judged(variant, number, folder, options.budget, options.memory)
                progress.step()
                if options.details:
                    print(f'  {name:36} {result.outcome:16} {result.criterion:12} {result.amount:>9} at '
                          f'{result.time} s  {result.words}', flush=True)
            for file in os.listdir(folder):
                (pathlib.Path(folder) / file).unlink()
    text = page(options, variants, results, scenes, referenced)
    if options.output:
        pathlib.Path(options.output).write_text(text)
    if options.only is None:
        print(text, end='')
    else:
        print(cells.output_of(ours, 'save', '--problem', f'random_{options.only}', '--variant', 'auto'), end='')


if __name__ == '__main__':
    main()
