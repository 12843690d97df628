"""Other engines as methods of a study, by the report's programs (bench/report, `--peers`)."""
import collections
import hashlib
import os
import pathlib
import signal
import subprocess
import tempfile

import numpy as np

Peer = collections.namedtuple('Peer', 'program variant hash')
GRACE = 5.0  # [s] beyond the limit: a program looks at its clock between samples only
OUTCOMES = {'not_finite': 'failed'}  # other outcomes have the name that a sweep gives them


def found_in(folder):
    """`ENGINE VARIANT` -> Peer, of all programs in a folder."""
    peers = {}
    for program in sorted(pathlib.Path(folder).glob('constraint_sim_report_*')):
        if not program.is_file() or not os.access(program, os.X_OK):
            continue
        peers.update(of_program(program))
    return peers


def of_program(program):
    """`ENGINE VARIANT` -> Peer, of one of them."""
    program, peers = pathlib.Path(program).resolve(), {}
    digest = hashlib.sha256(program.read_bytes()).hexdigest()[:16]
    listing = subprocess.run([program, 'list'], check=True, text=True, stdout=subprocess.PIPE, timeout=GRACE).stdout
    for line in listing.splitlines():
        name, _, _, engine, *_ = line.split('\t')
        peers[f'{engine} {name}'] = Peer(str(program), name, digest)
    return peers


def run(case, time_limit):
    """(outcome, detail, run time [s], figures by name, times, states); no states where there are none."""
    peer = case['peer']
    with tempfile.NamedTemporaryFile('w', suffix='.yaml') as scene:
        scene.write(case['text'])
        scene.flush()
        try:
            done = subprocess.run(
                [peer['program'], 'scene', scene.name, '--variant', peer['variant'], '--values',
                 repr(peer['tick']), '--duration', repr(case['duration']), '--sample', repr(peer['sample']),
                 '--budget', repr(time_limit)], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                timeout=time_limit + GRACE)
        except subprocess.TimeoutExpired:
            return 'hung', f'no end within {time_limit + GRACE:g} s', np.nan, {}, None, None
    if done.returncode < 0:
        return 'crashed', f'signal {signal.Signals(-done.returncode).name}', np.nan, {}, None, None
    lines = [line.split(maxsplit=6) for line in done.stdout.splitlines() if line.startswith('outcome ')]
    if done.returncode or not lines:
        return 'refused', done.stderr.strip(), np.nan, {}, None, None
    _, outcome, run_time, constraint, energy, penetration, *detail = lines[0]
    samples = np.array([[float(number) for number in line.split()[1:]]
                        for line in done.stdout.splitlines() if line.startswith('state ')])
    figures = {'max_constraint_error': float(constraint), 'energy_drift': float(energy),
               'max_penetration': float(penetration)}
    outcome, why = OUTCOMES.get(outcome, outcome), ' '.join(detail) or done.stderr.strip()
    if len(samples) == 0:
        return outcome, why, float(run_time), figures, None, None
    return outcome, why, float(run_time), figures, samples[:, 0], samples[:, 1:].reshape(len(samples), -1, 13)
