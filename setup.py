"""Tells catkin which Python packages go beside the generated messages. Not to be called by hand."""
from setuptools import setup

from catkin_pkg.python_setup import generate_distutils_setup

setup(**generate_distutils_setup(
    packages=['constraint_sim', 'constraint_sim.sweep', 'constraint_sim_client'], package_dir={'': 'python'}))
