"""Runs cases like the program, but a mass of 13 kg crashes it and one of 14 kg hangs it."""
import os
import signal
import sys
import time
from multiprocessing.connection import Connection

from constraint_sim.sweep import child

run_case = child.run_case


def run_or_not(case, *arguments):
    if 'mass: 13,' in case['text']:
        os.kill(os.getpid(), signal.SIGSEGV)
    if 'mass: 14,' in case['text']:
        time.sleep(1000.0)
    return run_case(case, *arguments)


if __name__ == '__main__':
    child.run_case = run_or_not
    child.main(Connection(int(sys.argv[1])), int(sys.argv[2]))
