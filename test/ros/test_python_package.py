#!/usr/bin/env python3
"""The engine's module and the messages in one process, from install space and from devel space."""
import os
import pathlib
import subprocess
import sys
import unittest

import rostest

SCRIPT = """
import sys
modules = ['constraint_sim.engine', 'constraint_sim.msg', 'constraint_sim.srv', 'constraint_sim.sweep']
for name in modules[::-1] if 'backwards' in sys.argv else modules:
    __import__(name)
import constraint_sim.engine, constraint_sim.msg
world = constraint_sim.engine.World()
world.add_body('bob', mass=1.0)
world.run(0.1)
body = constraint_sim.msg.Body(name=world.body_names[0], mass=world.body('bob')['mass'])
print(body.name, body.mass, constraint_sim.engine.__file__)
"""


def imports(environment, *arguments):
    return subprocess.run([sys.executable, "-c", SCRIPT, *arguments], env=environment, text=True,
                          stdout=subprocess.PIPE, check=True).stdout.split()


class PythonPackage(unittest.TestCase):
    def test_install_space(self):
        for order in ("forwards", "backwards"):
            name, mass, path = imports(os.environ, order)
            self.assertEqual((name, mass), ("bob", "1.0"))
            self.assertIn("install", path)

    def test_devel_space(self):
        build = pathlib.Path(__file__).resolve().parents[2] / "build/colcon/build/constraint_sim"
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        done = subprocess.run(["bash", "-c", '. "$1/devel/setup.bash" && env -0', "bash", build],
                              env=environment, stdout=subprocess.PIPE, check=True).stdout.decode()
        environment = dict(line.split("=", 1) for line in done.split("\0") if line)
        for order in ("forwards", "backwards"):
            name, mass, path = imports(environment, order)
            self.assertEqual((name, mass), ("bob", "1.0"))
            self.assertIn("devel", path)

    def test_command_finds_its_package(self):
        done = subprocess.run(["rosrun", "constraint_sim", "constraint_sim_sweep", "--help"],
                              stdout=subprocess.PIPE, text=True, check=True)
        self.assertIn("STUDY", done.stdout)


if __name__ == "__main__":
    rostest.rosrun("constraint_sim", "python_package", PythonPackage)
