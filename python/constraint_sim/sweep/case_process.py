"""Runs each case of a study in its own process. A crash or hang fails that case alone, and its result reports the
cause."""
import multiprocessing
import os
import signal
import subprocess
import sys

from .child import REFERENCE_PATIENCE

START_LIMIT = 60.0  # [s] until Python and numpy are loaded, on a busy machine
GRACE = 5.0  # [s] beyond the limit of a run: the engine looks at its clock between steps only


class CaseProcess:
    """A process that runs groups of cases, one after another; it is started anew when it died."""

    MODULE = 'constraint_sim.sweep.child'

    def __init__(self, memory=0):
        self.memory, self.process, self.connection = memory, None, None

    def start(self):
        self.connection, child = multiprocessing.Pipe()
        environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path)),
                       # one process a core: libraries need no threads of their own
                       'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}
        self.process = subprocess.Popen(
            [sys.executable, '-m', self.MODULE, str(child.fileno()), str(self.memory)],
            pass_fds=[child.fileno()], env=environment, stdin=subprocess.DEVNULL,
            start_new_session=True)  # Ctrl-C is for the command: it ends this one properly
        child.close()
        if not self.connection.poll(START_LIMIT) or self.receive() != ('ready',):
            raise RuntimeError(f'a process for cases did not start: {self.stop()}')

    def receive(self):
        """Next message; None when the process is gone."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            return None

    def stop(self):
        """Ends the process, and says how it ended."""
        if self.process is None:
            return ''
        self.connection.close()
        status = self.process.poll()
        if status is None:
            try:  # it may be about to end by itself
                status = self.process.wait(0.2)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.process = None
        if status is None:
            return 'it was ended'
        return f'signal {signal.Signals(-status).name}' if status < 0 else f'exit status {status}'

    def run(self, job, is_cancelled=lambda: False, reached=lambda key, share: None):
        """Results by key. A case during which the process died or took too long has the outcome
        `crashed` or `hung`; the others of the group are run again without it. `reached` hears of each
        case how much of it is done."""
        results, crashes = {}, 0
        while True:
            left = [case for case in job['cases'] if case['key'] not in results]
            if not left or is_cancelled():
                return results
            if self.process is None:
                self.start()
            current, trouble = None, self.run_once({**job, 'cases': left}, results, reached)
            if trouble is None:
                return results
            current, outcome, detail = trouble
            if current == 'reference':
                job = {**job, 'reference': None, 'trouble': f'the reference {outcome} ({detail})'}
            elif current is None:  # between cases: it was killed from outside
                crashes += 1
                if crashes > 3:
                    raise RuntimeError(f'a process for cases keeps dying: {detail}')
            else:
                results[current] = {'outcome': outcome, 'warnings': detail}

    def run_once(self, job, results, reached):
        """None, or (key of the case that was running, outcome, detail)."""
        current = None
        try:
            self.connection.send(job)
        except OSError:
            return None, 'crashed', self.stop()
        while True:
            limit = job['time_limit'] * (REFERENCE_PATIENCE if current == 'reference' else 1.0) + GRACE
            if not self.connection.poll(limit):
                self.process.kill()
                self.stop()
                return current, 'hung', f'no end within {limit:g} s'
            message = self.receive()
            if message is None:
                return current, 'crashed', self.stop()
            if message[0] == 'finished':
                return None
            if message[0] == 'begin':
                current = message[1]
            elif message[0] == 'reached':
                reached(*message[1:])
            else:
                results[message[1]] = message[2]
                current = None
