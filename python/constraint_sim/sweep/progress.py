"""A bar with the time left where somebody is looking, else a line now and then."""
import sys
import time

INTERVAL = 0.2  # [s] between two looks of a bar


class Progress:
    def __init__(self, title, total, stream=sys.stderr):
        self.title, self.total, self.done, self.stream = title, total, 0, stream
        self.start = self.shown = time.monotonic()

    def step(self, count=1):
        self.done += count
        now = time.monotonic()
        is_terminal = self.stream.isatty()
        if self.done <= 0 or now < self.shown + (INTERVAL if is_terminal else 30.0):
            return
        self.shown = now
        left = (now - self.start) * (self.total - self.done) / self.done
        filled = int(30 * self.done / self.total)
        line = (f'{self.title} [{"#" * filled}{" " * (30 - filled)}] {int(self.done)}/{self.total}, '
                f'about {left // 60:.0f} min {left % 60:.0f} s left')
        print(f'\r\x1b[K{line}' if is_terminal else line, end='' if is_terminal else '\n',
              file=self.stream, flush=True)

    def close(self):
        if self.stream.isatty():
            print('\r\x1b[K', end='', file=self.stream, flush=True)


class CaseProgress(Progress):
    """Progress of cases by key, which may be done in part: one round of three is a third."""

    def __init__(self, title, keys, stream=sys.stderr):
        self.shares = dict.fromkeys(keys, 0.0)
        super().__init__(title, len(self.shares), stream)

    def reached(self, shares):
        """Shares by key, 0 to 1. A share that is less than one heard before, of a case that runs twice, and
        keys that nobody waits for change nothing."""
        gained = 0.0
        for key, share in shares.items():
            before = self.shares.get(key, 1.0)
            if share > before:
                self.shares[key] = share
                gained += share - before
        self.step(gained)


class Teller:
    """Passes on the shares of cases, together and not more often than a bar looks."""

    def __init__(self, tell):
        self.tell, self.shares, self.told = tell, {}, time.monotonic()

    def __call__(self, key, share):
        self.shares[key] = share
        now = time.monotonic()
        if now >= self.told + INTERVAL:
            self.tell(self.shares)
            self.shares, self.told = {}, now
