"""Makes the Python package of these sources importable: the report and `constraint_sim_sweep --report` share
how figures are judged and pages written."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / 'python'))
