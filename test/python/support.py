"""Helpers shared by the tests of Python. CONSTRAINT_SIM_RUN is the runner's path; scripts/test sets it."""
import os
import pathlib
import subprocess
import sys

SOURCES = pathlib.Path(__file__).resolve().parent.parent.parent
SCENES = SOURCES / 'config/scenes'
RUNNER = os.environ['CONSTRAINT_SIM_RUN']
ENVIRONMENT = {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}


def run_example(name):
    return subprocess.run([sys.executable, SOURCES / 'examples' / name], check=True, text=True,
                          stdout=subprocess.PIPE, env=ENVIRONMENT).stdout
