"""Runs the report's programs cell by cell and keeps what they print.

A cell is a problem, a contestant and a setting. Each batch of settings runs in a process of its own:
engines crash and hang, and then lose that setting and nothing else. Lines are appended to CSV files
as they come, so an interrupted run goes on where it stopped.
"""
import collections
import concurrent.futures
import csv
import hashlib
import json
import os
import pathlib
import resource
import selectors
import subprocess
import sys
import threading
import time

Variant = collections.namedtuple('Variant', 'program name coordinates knob engine version values')
Problem = collections.namedtuple(
    'Problem', 'name group graded duration length tick_scale invalid conflict has_reference source')
Batch = collections.namedtuple('Batch', 'round problem variant values grid')

# Columns that `header` of a program prints, and the round.
COLUMNS = {
    'round': 'which of the interleaved rounds this run belongs to, from 1; errors stand in the first '
             'only. 0: a perturbed method',
    'problem': 'the scene, a name of bench/report/problems',
    'contestant': 'the engine and the way it is used',
    'knob': '`tick`: value is the length of a step; `tolerance`: what its error control is asked for',
    'value': 'of the knob: a tick in seconds, a tolerance in the terms of the engine',
    'outcome': '`ok`; `not_finite`; `too_slow`: beyond the budget, errors are those until then; '
               '`refused` by the engine; `unsupported` by the adapter; `crashed`; `hung`',
    'run_time': 'run time over simulated time, without building, measuring, and what other processes '
                'had of the processor meanwhile [µs/s]',
    'ticks': 'steps asked of the engine',
    'memory': 'resident memory that building the scene and its first ticks took; only of the scenes of '
              'scaling.csv [bytes]',
    'position': 'largest distance of a centre of mass from the reference [m]',
    'orientation': 'largest angle from the reference [rad]',
    'energy': 'largest change of the energy over the largest kinetic energy (of a scene at rest: '
              'over its weight times its size) [1]',
    'momentum': 'largest distance of the linear or angular momentum from that of the reference over '
                'its largest value [1]',
    'constraint': 'largest error of a rod or joint, angles of axes times the radius of gyration of a body [m]',
    'penetration': 'deepest overlap of spheres, of spheres or boxes and planes [m]',
    'distance': 'how far a body came from its start at most [m]',
}
TIMED = list(COLUMNS).index('position')  # number of columns before the errors
GRACE = 5.0  # time beyond twice the budget that a process may take for a setting [s]


def programs(folder):
    return sorted(path for path in pathlib.Path(folder).glob('constraint_sim_report_*')
                  if os.access(path, os.X_OK) and path.is_file())


def output_of(program, *arguments):
    return subprocess.run([program, *arguments], check=True, text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL).stdout


def variants(folder):
    """Returns the variants of all programs; this engine first."""
    found = []
    for program in programs(folder):
        for line in output_of(program, 'list').splitlines():
            name, coordinates, knob, engine, version, values = line.split('\t')
            found.append(Variant(program, name, coordinates, knob, engine, version,
                                 [float(value) for value in values.split()]))
    return sorted(found, key=lambda variant: variant.engine != 'constraint_sim')


def label(variant):
    """Returns the name of a contestant."""
    return f'{variant.engine} {variant.name}'


def problems(program):
    if output_of(program, 'header').strip().split(',') != list(COLUMNS)[1:]:
        raise RuntimeError(f'{program} prints other columns than COLUMNS describes')
    found = {}
    for line in output_of(program, 'problems').splitlines():
        name, group, graded, duration, length, scale, invalid, conflict, reference, source = \
            line.split('\t')
        found[name] = Problem(name, group, graded == '1', float(duration), float(length),
                              float(scale), invalid == '1', conflict == '1', reference == '1', source)
    return found


class ProgressBar:
    """Shows progress of all batches, with the remaining time, on a terminal; else prints a line now and
    then. Remaining batches are assumed as expensive as finished ones."""

    def __init__(self, total):
        self.title, self.total, self.done = '', total, 0
        self.start = self.shown = time.monotonic()
        self.lock = threading.Lock()

    def step(self, count=1):
        with self.lock:
            self.done += count
            now = time.monotonic()
            interval = 0.2 if sys.stderr.isatty() else 30.0
            if not self.done or (now < self.shown + interval and self.done < self.total):
                return
            self.shown = now
            left = (now - self.start) * (self.total - self.done) / self.done
            width = 30 * self.done // self.total
            is_terminal = sys.stderr.isatty()
            start = '\x1b[K' if is_terminal else ''
            end = '\r' if is_terminal and self.done < self.total else '\n'
            print(f'{start}{self.title} [{"#" * width}{" " * (30 - width)}] '
                  f'{self.done}/{self.total}, about {left // 60:.0f} min {left % 60:.0f} s left in all',
                  end=end, file=sys.stderr, flush=True)

    def skip(self, count):
        """Counts batches that are done already, or not needed."""
        with self.lock:
            self.total -= count


def lines_within(process, limit):
    """Yields lines of a process as they arrive; None when `limit` seconds passed without one."""
    selector = selectors.DefaultSelector()
    selector.register(process.stdout, selectors.EVENT_READ)
    rest = b''
    while True:
        if not selector.select(limit):
            yield None
            return
        data = os.read(process.stdout.fileno(), 65536)
        if not data:
            return
        *whole, rest = (rest + data).split(b'\n')
        for line in whole:
            yield line.decode()


def run_batch(batch, references, budget, repeats, perturbation, memory):
    """Yields rows of the CSV files. A setting that crashes or hangs is noted, and the others go on."""
    variant, values, rows = batch.variant, list(batch.values), []
    contestant = label(variant) + (' perturbed' if perturbation else '')
    while values:
        command = [variant.program, 'run', references, '--problem', batch.problem, '--variant',
                   variant.name, '--budget', str(budget), '--repeats', str(repeats),
                   '--perturb', str(perturbation), *(['--grid'] if batch.grid else []),
                   '--values', *(f'{value:.12g}' for value in values)]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for this program: running processes are ended properly
            preexec_fn=lambda: memory and resource.setrlimit(resource.RLIMIT_AS, (memory, memory)))
        current, outcome, finished = None, None, 0
        for line in lines_within(process, 2.0 * budget + GRACE):
            if line is None:
                outcome = 'hung'
                process.kill()
            elif line.startswith('begin '):
                current = line.split()[1]
            elif line.startswith(batch.problem + ','):
                rows.append([str(batch.round), *line.split(',')])
                current = None
                finished += 1
        process.stdout.close()
        status = process.wait()
        if current is None:
            if status != 0 and finished == 0:
                raise RuntimeError(f'failed with {status}: {" ".join(map(str, command))}')
            return rows
        outcome = outcome or 'crashed'
        rows.append([str(batch.round), batch.problem, contestant, 'tick' if batch.grid else variant.knob,
                     current, outcome, 'nan', '0'] + ['nan'] * 8)
        # more expensive settings would hang longer
        values = [] if outcome == 'hung' else values[finished + 1:]
    return rows


class Table:
    """A growing CSV file, and its complete batches."""

    def __init__(self, path, is_fresh):
        self.path = pathlib.Path(path)
        self.done_path = self.path.with_suffix('.done')
        if is_fresh or not self.path.exists():
            self.path.write_text(','.join(COLUMNS) + '\n')
            self.done_path.write_text('')
        self.done = set(self.done_path.read_text().splitlines())
        self.lock = threading.Lock()

    @staticmethod
    def key(batch):
        return f'{batch.round} {batch.problem} {label(batch.variant)}'

    def has(self, batch):
        return self.key(batch) in self.done

    def add(self, batch, rows):
        with self.lock:
            with open(self.path, 'a', newline='') as file:
                csv.writer(file, lineterminator='\n').writerows(rows)
            with open(self.done_path, 'a') as file:
                file.write(self.key(batch) + '\n')
            self.done.add(self.key(batch))

    def rows(self):
        """Yields rows of complete batches; incomplete ones are remains of an interruption."""
        with open(self.path, newline='') as file:
            return [row for row in csv.DictReader(file)
                    if f'{row["round"]} {row["problem"]} {row["contestant"].replace(" perturbed", "")}'
                    in self.done]


def finish(workers, function, items):
    """Calls the function for each item on this many threads. After a failure or an interruption, running
    calls are finished and the others are dropped."""
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(function, item) for item in items]
        try:
            for future in futures:
                future.result()
        except BaseException:
            for future in futures:
                future.cancel()
            raise


def run_all(title, batches, table, workers, progress, **settings):
    left = [batch for batch in batches if batch.values and not table.has(batch)]
    progress.skip(len(batches) - len(left))
    progress.title = title

    def run(batch):
        rows = run_batch(batch, **settings)
        if batch.round > 1:  # errors come from the first round
            rows = [row[:TIMED] + [''] * (len(row) - TIMED) for row in rows]
        table.add(batch, rows)
        progress.step()

    finish(workers, run, left)


def repeat(number, batches, values, table, progress, **settings):
    """Runs the batches once more, with these values of (problem, contestant)."""
    again = [batch._replace(round=number, values=values.get((batch.problem, label(batch.variant)), []))
             for batch in batches]
    run_all(f'{table.path.stem}, round {number}', again, table, 1, progress, **settings)


def make_references(program, folder, names, sources, progress):
    """Computes missing references in `folder`; all of them when the problems changed."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(b''.join(path.read_bytes() for path in sorted(sources))).hexdigest()
    errors_path, digest_path = folder / 'errors.json', folder / 'digest'
    errors = {}
    if digest_path.exists() and digest_path.read_text() == digest and errors_path.exists():
        errors = json.loads(errors_path.read_text())
    digest_path.write_text(digest)
    missing = [name for name in names if name not in errors]
    progress.skip(len(names) - len(missing))
    progress.title = 'references'

    def make(name):
        line = output_of(program, 'references', folder, '--problem', name)
        errors[name] = float(line.split('\t')[1])
        progress.step()

    finish(os.cpu_count(), make, missing)
    errors_path.write_text(json.dumps(errors))
    return errors
