"""A bar with the time left where somebody is looking, else a line now and then."""
import sys
import time


class Progress:
    def __init__(self, title, total, stream=sys.stderr):
        self.title, self.total, self.done, self.stream = title, total, 0, stream
        self.start = self.shown = time.monotonic()

    def step(self, count=1):
        self.done += count
        now = time.monotonic()
        is_terminal = self.stream.isatty()
        if now < self.shown + (0.2 if is_terminal else 30.0):
            return
        self.shown = now
        left = (now - self.start) * (self.total - self.done) / self.done
        filled = 30 * self.done // self.total
        line = (f'{self.title} [{"#" * filled}{" " * (30 - filled)}] {self.done}/{self.total}, '
                f'about {left // 60:.0f} min {left % 60:.0f} s left')
        print(f'\r\x1b[K{line}' if is_terminal else line, end='' if is_terminal else '\n',
              file=self.stream, flush=True)

    def close(self):
        if self.stream.isatty():
            print('\r\x1b[K', end='', file=self.stream, flush=True)
