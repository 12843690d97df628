"""Where cases run: threads of this process, or the workers of a Dask cluster. Each executor takes jobs, and
`filled` that puts the texts into one, and yields results by key as they come, in any order. `reached` hears
meanwhile, on the caller's thread, how far cases are: {key: share}."""
import collections
import queue
import socket
import sys
import threading
import time
import uuid

from . import child
from .case_process import CaseProcess
from .program import identity
from .progress import Teller

CONNECT_LIMIT = 20.0  # [s] until a scheduler answers


def batches_of(jobs, workers):
    """Lists of jobs: large enough to be worth sending, small enough that results come in pieces."""
    size = max(1, min(50, len(jobs) // (8 * workers)))
    return [jobs[at:at + size] for at in range(0, len(jobs), size)]


# ---- threads

class Stopped(BaseException):
    pass


class Reached(dict):
    """Shares of cases, among results in a queue."""


def on_threads(jobs, filled, count, reached):
    """In this process, several worlds at a time: the engine holds no GIL. A crash of the engine would end
    the command; what was done until then is kept. When it is stopped, runs that have begun are ended first:
    Python must not end under them."""
    waiting, results = queue.SimpleQueue(), queue.SimpleQueue()
    for job in jobs:
        waiting.put(job)
    stop = threading.Event()

    def begin(_):
        if stop.is_set():
            raise Stopped

    def work():
        tell = Teller(lambda shares: results.put(Reached(shares)))
        try:
            while True:
                found = {}
                child.run_group(filled(waiting.get_nowait()), begin, found.__setitem__, tell)
                results.put(found)
        except (queue.Empty, Stopped):
            pass
        except BaseException as error:
            results.put(error)

    threads = [threading.Thread(target=work) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        left = len(jobs)
        while left:
            found = results.get()
            if isinstance(found, BaseException):
                raise found
            if isinstance(found, Reached):
                reached(found)
                continue
            left -= 1
            yield found
    finally:
        stop.set()
        for thread in threads:
            thread.join()


# ---- Dask

_of_thread = threading.local()


def tell_of(topic):
    """Returns, on a worker, the function that reports progress; it does nothing where Dask has no events."""
    import distributed
    worker = distributed.get_worker()
    return Teller(lambda shares: worker.log_event(topic, {'shares': shares})) if hasattr(worker, 'log_event') \
        else lambda key, share: None


def run_batch(batch, program, memory, topic):
    """On a worker. (its program, results by key); no results from a worker of another program."""
    own = identity()
    if own != program:
        return own, {}
    if not hasattr(_of_thread, 'process'):
        _of_thread.process = CaseProcess(memory)
    results, reached = {}, tell_of(topic)
    for job in batch:
        results.update(_of_thread.process.run(job, reached=reached))
    for result in results.values():
        result['worker'] = socket.gethostname()
    return own, results


def keys_of(batch):
    return {case['key'] for job in batch for case in job['cases']}


class Cluster:
    """Gives batches to the workers of a Dask scheduler, a few to each. What a worker had when it died goes
    to others, workers that come late get what is left, and those of another program get nothing."""

    ATTEMPTS = 5
    PATIENCE = 60.0  # [s] without any worker that may be used

    def __init__(self, client, filled, memory, reached):
        self.client, self.filled, self.memory, self.program = client, filled, memory, identity()
        self.reached, self.topic = reached, f'constraint_sim {uuid.uuid4()}'
        self.finished = queue.SimpleQueue()  # futures, and what workers tell meanwhile
        if hasattr(client, 'subscribe_topic'):
            client.subscribe_topic(self.topic, lambda event: self.finished.put(Reached(event[1]['shares'])))
        self.accepted, self.refused = {}, {}
        self.flying = {}  # future -> (worker, batch number)
        self.attempts = collections.Counter()

    def look_for_workers(self):
        present = self.client.scheduler_info()['workers']
        for address, facts in present.items():
            if address in self.accepted or address in self.refused:
                continue
            try:
                own = self.client.run(identity, workers=[address])[address]
            except Exception as error:  # it left meanwhile, or cannot even load the question
                if address not in self.client.scheduler_info()['workers']:
                    continue
                own = f'no constraint_sim that answers: {error}'
            if own == self.program:
                self.accepted[address] = facts['nthreads']
            else:
                self.refused[address] = own
                print(f'worker {address} is not used: it has {own}, this command {self.program}',
                      file=sys.stderr)
        for address in set(self.accepted) - set(present):
            del self.accepted[address]
            print(f'worker {address} is gone', file=sys.stderr)
        for address in set(self.refused) - set(present):
            del self.refused[address]

    def give(self, batches, waiting, wanted):
        """Keeps each worker busy; once nothing waits, what is still out is given to idle ones as well."""
        for address, threads in self.accepted.items():
            at_work = sum(worker == address for worker, _ in self.flying.values())
            while waiting and at_work < threads + 1:
                self.submit(address, waiting.popleft(), batches)
                at_work += 1
            if not waiting and at_work == 0:
                out = collections.Counter(number for _, number in self.flying.values())
                for number, copies in sorted(out.items()):
                    if copies == 1 and keys_of(batches[number]) & wanted:
                        self.submit(address, number, batches)
                        break

    def submit(self, address, number, batches):
        future = self.client.submit(
            run_batch, [self.filled(job) for job in batches[number]], self.program, self.memory, self.topic,
            workers=[address], allow_other_workers=False, pure=False, retries=0)
        self.flying[future] = address, number
        future.add_done_callback(self.finished.put)

    def drop_lost(self, waiting):
        """Batches of workers that are gone wait again."""
        for future, (address, number) in list(self.flying.items()):
            if address in self.accepted:
                continue
            del self.flying[future]
            future.cancel()
            if all(other != number for _, other in self.flying.values()):
                waiting.append(number)

    def run(self, jobs):
        threads = sum(facts['nthreads'] for facts in self.client.scheduler_info()['workers'].values())
        batches = batches_of(jobs, max(threads, 1))
        wanted = set().union(*map(keys_of, batches))
        waiting, looked, used = collections.deque(range(len(batches))), -1.0, time.monotonic()
        try:
            while wanted:
                if time.monotonic() > looked + 0.5:
                    self.look_for_workers()
                    self.drop_lost(waiting)
                    looked = time.monotonic()
                used = time.monotonic() if self.accepted else used
                if time.monotonic() > used + self.PATIENCE:
                    raise RuntimeError(f'no worker for {self.PATIENCE:g} s; refused: '
                                       + (', '.join(self.refused) or 'none'))
                self.give(batches, waiting, wanted)
                try:
                    future = self.finished.get(timeout=0.25)
                except queue.Empty:
                    continue
                if isinstance(future, Reached):
                    self.reached(future)
                elif future in self.flying:
                    _, number = self.flying.pop(future)
                    found = self.results_of(future, number, waiting)
                    found = {key: result for key, result in found.items() if key in wanted}
                    wanted -= set(found)
                    yield found
        finally:
            for future in list(self.flying):
                future.cancel()

    def results_of(self, future, number, waiting):
        error = None
        try:
            own, found = future.result()
            if found:
                return found
            error = f'it has {own}'
        except Exception as reason:  # Dask: killed, cancelled, lost on the way
            error = repr(reason)
        self.attempts[number] += 1
        if self.attempts[number] >= self.ATTEMPTS:
            raise RuntimeError(f'a batch was given to workers {self.ATTEMPTS} times and did not come '
                               f'back: {error}')
        if all(other != number for _, other in self.flying.values()):
            waiting.append(number)
        return {}


def on_cluster(jobs, filled, count, address, memory, reached):
    try:
        import dask
        import distributed
    except ImportError as error:
        raise RuntimeError(f'{error}: install python3-distributed, or use --on threads') from None
    dask.config.set({'distributed.comm.timeouts.connect': '10s',
                     'distributed.scheduler.allowed-failures': 100})
    cluster = None
    if address is None:
        # threads are enough: each has its cases in a process of its own
        cluster = distributed.LocalCluster(n_workers=count, threads_per_worker=1, processes=False,
                                           dashboard_address=None, silence_logs=50)
    try:
        client = distributed.Client(cluster if address is None else address, timeout=CONNECT_LIMIT,
                                    set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise RuntimeError(f'--cluster {address}: no scheduler there: {error}') from None
    try:
        yield from Cluster(client, filled, memory, reached).run(jobs)
    finally:
        client.close(timeout=5)
        if cluster is not None:
            cluster.close(timeout=5)
