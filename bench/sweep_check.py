#!/usr/bin/env python3
"""Measures costs of sweeps, and checks that nothing is lost: a study of many cases on threads, on a local cluster,
and on a scheduler with three workers, one of them killed and one late; interrupted ten times and resumed; compared
with the runner; the overhead of a case, and two workers against one.

  PYTHONPATH=build/engine/python:python bench/sweep_check.py [--cases 2000] [--runner build/engine/constraint_sim_run]

Exits with 1 when a table or a hash differs, or a bound is not held.
"""
import argparse
import csv
import ctypes
import json
import os
import pathlib
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'test/python'))
COMMAND = [sys.executable, str(ROOT / 'src/tools/constraint_sim_sweep')]
FINISHED_BUT_TOLD = 4  # exit status of the runner: unclosed errors of joints
SCENE = """world: {time_step: 0.01}
bodies:
  - {name: a, mass: 1, position: [1, 0, 0]}
  - {name: b, mass: 1, position: [2, 0, 0]}
constraints:
  - {name: rod_a, body_b: a}
  - {name: rod_b, body_a: a, body_b: b}
"""
STUDY = """scene: scene.yaml
duration: DURATION
parameters: {mass: {path: bodies.b.mass, logarithmic: [0.01, 100, COUNT]}}
methods: [auto, sequential_impulses]
"""


def make(folder, cases, duration):
    folder.mkdir()
    (folder / 'scene.yaml').write_text(SCENE)
    path = folder / 'study.yaml'
    path.write_text(STUDY.replace('COUNT', str(cases // 2)).replace('DURATION', str(duration)))
    return path


def start(path, *options):
    return subprocess.Popen([*COMMAND, str(path), '--no-plots', *map(str, options)], env=support_environment(),
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def support_environment():
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}


def finish(process):
    error = process.communicate()[1]
    if process.returncode:
        raise SystemExit(f'sweep_check: exit status {process.returncode}: {error}')


def table(path):
    from constraint_sim.sweep.store import TIMING
    with open(path.with_suffix('.results') / 'results.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    return [{name: value for name, value in row.items() if name not in TIMING} for row in rows], \
        sum(float(row['run_time']) for row in rows)


def done(path):
    file = path.with_suffix('.results') / 'results.jsonl'
    return len(file.read_bytes().splitlines()) if file.exists() else 0


def runner_hashes(path, runner, folder):
    from constraint_sim.sweep import study
    loaded, hashes, first = study.load(path), [], 0
    for scene, values in loaded.points():
        for case in loaded.cases_at(first, scene, values):
            (folder / 'case.yaml').write_text(loaded.text_of(case))
            done = subprocess.run([runner, folder / 'case.yaml', '--duration', str(loaded.duration), '--report',
                                   folder / 'case.json'], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            if done.returncode not in (0, FINISHED_BUT_TOLD):
                raise SystemExit(f'sweep_check: {runner}: exit status {done.returncode}: {done.stderr}')
            hashes.append(json.loads((folder / 'case.json').read_text())['state_hash'])
            first = case.index + 1
    return hashes


def on_machines(path, folder):
    """Runs on three workers; the first is killed once results arrive, and a fourth joins then."""
    os.environ.setdefault('CONSTRAINT_SIM_RUN', 'unused')
    from test_sweep import Machines, wait_until
    machines = Machines(folder)
    try:
        first = [machines.worker() for _ in range(3)][0]
        sweep = start(path, '--cluster', machines.address)
        wait_until(lambda: done(path) > 0)
        first.kill()
        machines.worker()
        at_kill = done(path)
        finish(sweep)
        return at_kill
    finally:
        machines.stop()


def interrupted(path, times):
    """Sends SIGINT and SIGKILL alternately, at random times; then runs to the end."""
    moments = random.Random(1)
    counts = [0]
    for number in range(times):
        sweep = start(path, '--on', 'threads' if number % 3 else 'cluster')
        while done(path) <= counts[-1] and sweep.poll() is None:
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 0.1))
        sweep.send_signal(signal.SIGKILL if number % 2 else signal.SIGINT)
        sweep.communicate()
        counts.append(done(path))
    finish(start(path, '--on', 'threads'))
    return counts[1:]


def adopt_orphans():
    """Makes this process the parent of orphans: a command ends before its processes for cases, whose processor time
    only their parent knows."""
    PR_SET_CHILD_SUBREAPER = 36
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), 'prctl')


def wait_for_orphans():
    try:
        while True:
            os.waitpid(-1, 0)
    except ChildProcessError:
        pass


def timed(path, *options):
    """Returns wall time and processor time of the command and its processes [s]."""
    wait_for_orphans()
    def processor():
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime
    begun, before = time.monotonic(), processor()
    finish(start(path, *options))
    wall = time.monotonic() - begun
    wait_for_orphans()
    return wall, processor() - before


def busy_time():
    """Returns the busy time of all processors since the start of the machine [s]."""
    with open('/proc/stat') as file:
        ticks = [int(word) for word in file.readline().split()[1:9]]
    return (sum(ticks) - ticks[3] - ticks[4]) / os.sysconf('SC_CLK_TCK')  # idle, waiting for disks


def check_tables(check, folder, cases, runner):
    threads = make(folder / 'threads', cases, 2)
    timed(threads, '--on', 'threads')
    whole, _ = table(threads)
    hashes = runner_hashes(threads, runner, folder)
    same = sum(row['state_hash'] == found for row, found in zip(whole, hashes))
    check(len(whole) == len(hashes) == same == cases,
          f'on threads: {len(whole)} cases, {same} of them with the bits of the runner')

    local = make(folder / 'local', cases, 2)
    timed(local)
    check(table(local)[0] == whole, 'on a local cluster: the same table')

    remote = make(folder / 'remote', cases, 2)
    at_kill = on_machines(remote, folder)
    check(table(remote)[0] == whole and at_kill < cases,
          f'on a scheduler with three workers, one killed after {at_kill} cases and one late: the same table')

    stopped = make(folder / 'stopped', cases, 2)
    counts = interrupted(stopped, 10)
    check(table(stopped)[0] == whole, f'interrupted after {counts} cases and resumed: the same table')


def check_times(check, folder, cases):
    short = make(folder / 'short', cases, 2)
    taken, processor = timed(short)
    run_time = table(short)[1]
    # processor time, since other processes may have used the processor meanwhile
    overhead = 1e3 * (processor - run_time) / cases
    check(overhead < 5.0, f'overhead of a case: {overhead:.2f} ms of the processor, starting and writing '
                          f'included; {cases} cases of {1e3 * run_time / cases:.2f} ms took {taken:.1f} s')

    count, times = max(cases // 40, 10), ([], [])
    begun, before = time.monotonic(), busy_time()
    for number in range(3):
        for workers in (1, 2):
            path = make(folder / f'long_{number}_{workers}', count, 2000)
            wall, used = timed(path, '--workers', workers)
            times[workers - 1].append(wall)
            before += used
    # time of other processes is missing to two workers, not to one
    others = (busy_time() - before) / (time.monotonic() - begun) / os.cpu_count()
    one, two = map(min, times)
    run_time = table(path)[1] / count
    check(one / two >= 1.7 or os.cpu_count() < 2,
          f'{count} cases of {run_time:.2f} s, best of three: one worker {one:.1f} s, two {two:.1f} s: '
          f'{one / two:.2f} times; others had {100.0 * max(others, 0.0):.0f} % of the processors')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--cases', type=int, default=2000)
    parser.add_argument('--only-times', action='store_true', help='overhead, and two workers against one')
    parser.add_argument('--runner', default=str(ROOT / 'build/engine/constraint_sim_run'))
    options = parser.parse_args()
    problems = []
    adopt_orphans()

    def check(holds, line):
        print(('' if holds else 'NOT HELD: ') + line, flush=True)
        problems.extend([] if holds else [line])

    with tempfile.TemporaryDirectory() as name:
        if not options.only_times:
            check_tables(check, pathlib.Path(name), options.cases, options.runner)
        check_times(check, pathlib.Path(name), options.cases)
    return 1 if problems else 0


if __name__ == '__main__':
    sys.exit(main())
