"""Results as they come, in a folder: a study that was stopped goes on where it was."""
import fcntl
import json
import math
import os
import pathlib

import numpy as np

RESULTS = 'results.jsonl'
TIMING = ('run_time', 'run_time_spread', 'worker')  # columns that another run need not repeat


class StoreError(RuntimeError):
    pass


class Store:
    """RESULTS, a line each case, appended; a line cut off by an interruption is dropped."""

    def __init__(self, folder, fresh=False):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.path = self.folder / RESULTS
        self.file = open(self.path, 'a+')
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StoreError(f'{self.folder}: another sweep is writing there') from None
        if fresh:
            self.file.truncate(0)
        self.results, good = {}, 0
        with open(self.path, 'rb') as lines:
            for line in lines:
                try:
                    entry = json.loads(line)
                    if not line.endswith(b'\n'):
                        break
                    self.results[entry.pop('key')] = entry
                except (ValueError, KeyError, AttributeError):
                    break
                good += len(line)
        self.file.truncate(good)

    def add(self, results):
        """Results by key, kept for good. A case that is there already must have the same bits."""
        lines = []
        for key, result in results.items():
            result = dict(result)
            samples = result.pop('samples', None)
            before = self.results.get(key)
            if before and 'ok' == result['outcome'] == before['outcome'] and \
                    before['state_hash'] != result['state_hash']:
                raise StoreError(f'case {key}: two runs of the same program gave '
                                 f'{before["state_hash"]} and {result["state_hash"]}')
            if samples is not None:
                self.write_samples(key, *samples)
            self.results[key] = result
            lines.append(json.dumps({'key': key, **{name: None if isinstance(value, float) and
                                                    math.isnan(value) else value
                                                    for name, value in result.items()}}) + '\n')
        if lines:
            self.file.write(''.join(lines))
            self.file.flush()

    def write_samples(self, key, times, states):
        folder = self.folder / 'samples'
        folder.mkdir(exist_ok=True)
        part = folder / f'{key}.part'
        with open(part, 'wb') as file:
            np.savez(file, times=times, states=states)
        os.replace(part, folder / f'{key}.npz')

    def samples(self, key):
        with np.load(self.folder / 'samples' / f'{key}.npz') as file:
            return file['times'], file['states']

    def close(self):
        self.file.close()
