#!/usr/bin/env python3
"""watch_error and bag_report on a running node and on bags with known figures; rviz_config."""
import csv
import os
import subprocess
import tempfile
import unittest

import rosbag
import rospkg
import rospy
import rostest
import yaml
from constraint_sim.msg import Statistics

import support
from support import node_command, properties, running


def run(*command):
    return subprocess.run(["rosrun", "constraint_sim", *command], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, universal_newlines=True,
                          timeout=support.TIMEOUT)


def statistics(step, wall_mean, error, drift=0.0):
    """Returns a message with a tick of 1 ms."""
    return Statistics(sim_time=rospy.Time.from_sec(1e-3 * step), step=step, ticks=100,
                      wall_mean=wall_mean, max_constraint_error=error, energy_drift=drift,
                      methods=["runge_kutta"])


class Tools(unittest.TestCase):
    def write_bag(self, path, messages):
        with rosbag.Bag(path, "w") as bag:
            for i, message in enumerate(messages):
                bag.write("/sim/statistics", message, rospy.Time(i + 1))

    def test_watch_error_prints_a_line_for_each_message(self):
        with running(node_command(scene="pendulum")):
            properties()  # the node is up
            done = run("watch_error", "--messages", "3", "--no-window")
        self.assertEqual(done.returncode, 0, done.stdout)
        lines = [line.split() for line in done.stdout.splitlines() if "runge_kutta" in line]
        self.assertEqual(len(lines), 3, done.stdout)
        times = [float(line[0]) for line in lines]
        self.assertEqual(times, sorted(set(times)))
        for _, cost, error, *_ in lines:
            self.assertGreater(float(cost), 0.0)
            self.assertLess(float(error), 1e-12)  # rods hold to rounding

    def test_bag_report_has_the_figures_of_the_bag(self):
        with tempfile.TemporaryDirectory() as folder:
            bag = os.path.join(folder, "run.bag")
            # 2 and 4 µs a tick of 1 ms are 2000 and 4000 µs/s; the pause in between gives no line
            self.write_bag(bag, [statistics(0, 1e-6, 0.0), statistics(100, 2e-6, 1e-5),
                                 statistics(100, 9e-6, 1e-5), statistics(200, 4e-6, 3e-5, -0.25)])
            done = run("bag_report", bag, "--output", folder)
            self.assertEqual(done.returncode, 0, done.stdout)
            with open(os.path.join(folder, "sim_statistics.csv")) as file:
                lines = list(csv.DictReader(file))
            with open(os.path.join(folder, "sim_statistics.svg")) as file:
                self.assertIn("<svg", file.read())
        self.assertEqual(len(lines), 2)
        for line, time, run_time, error, drift in zip(lines, (0.1, 0.2), (2000, 4000), (1e-5, 3e-5),
                                                      (0.0, 0.25)):
            self.assertAlmostEqual(float(line["sim_time"]), time)
            self.assertAlmostEqual(float(line["run_time"]), run_time, delta=1e-6)  # rounding
            self.assertEqual(float(line["constraint_error"]), error)
            self.assertEqual(float(line["energy_drift"]), drift)
        self.assertIn("3e-05 at most", done.stdout)

    def test_what_dies_as_it_starts_is_tried_a_second_time_and_once_only(self):
        script = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "scripts", "try_twice")
        with tempfile.TemporaryDirectory() as folder:
            for lives, status, said in ((0, 7, 1), (1, 0, 1), (2, 0, 0)):
                # succeeds once there are three marks, `lives` of which exist before
                marks = os.path.join(folder, "marks")
                with open(marks, "w") as file:
                    file.write("x" * lives)
                done = subprocess.run(
                    [script, "bash", "-c", 'printf x >>"%s"; [ $(wc -c <"%s") -ge 3 ] || exit 7'
                     % (marks, marks)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                    universal_newlines=True, timeout=support.TIMEOUT)
                self.assertEqual(done.returncode, status)
                self.assertEqual(done.stdout.count("trying a second time"), said, done.stdout)

    def test_rviz_config_fits_a_scene_or_what_a_node_has(self):
        def view(*arguments):
            done = run("rviz_config", *arguments)
            self.assertEqual(done.returncode, 0, done.stdout)
            config = yaml.safe_load(done.stdout)
            return config["Visualization Manager"]["Views"]["Current"]

        small = view("gripper")  # 0.2 m wide, below 1 m
        self.assertTrue(0.2 < small["Distance"] < 1.0, small)
        self.assertAlmostEqual(small["Focal Point"]["Z"], 0.95, delta=0.1)
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as scene:
            scene.write("bodies: [{name: a, mass: 1, position: [0, 0, 0]},"
                        " {name: b, mass: 1, position: [100, 0, 0]}]")
            scene.flush()
            large = view(scene.name)
            self.assertTrue(50.0 < large["Distance"] < 300.0, large)
            self.assertAlmostEqual(large["Focal Point"]["X"], 50.0, delta=1e-6)
            with running(node_command(scene=scene.name, paused="true")):
                properties()
                self.assertEqual(view("--node", "/constraint_sim"), large)
        done = run("rviz_config", "no_such_scene")
        self.assertEqual(done.returncode, 2)
        self.assertIn("no_such_scene", done.stdout)

    def test_a_bag_without_statistics_is_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            bag = os.path.join(folder, "empty.bag")
            self.write_bag(bag, [])
            for path in (bag, os.path.join(folder, "missing.bag")):
                done = run("bag_report", path)
                self.assertEqual(done.returncode, 1)
                self.assertIn(path, done.stdout)


if __name__ == "__main__":
    rostest.rosrun("constraint_sim", "tools", Tools)
