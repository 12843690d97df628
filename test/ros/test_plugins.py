#!/usr/bin/env python3
"""A separate package (test/plugin_example), built here against the installed one, adds wind, a constraint
and a sensor to the node."""
import math
import os
import subprocess
import tempfile
import unittest

import rosbag
import rospkg
import rospy
import rostest
from constraint_sim.msg import Constraint, EditRecord, Parameter
from rosgraph_msgs.msg import Log
from std_msgs.msg import Float64

from support import NODE, TIMEOUT, Listener, call, node_command, properties, running, wait_until

SOURCES = os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "plugin_example")
PLUGIN = "constraint_sim_plugin_example/Weather"


def build(to):
    """Builds and installs the package below `to`; returns the environment for its use."""
    prefix = os.path.join(to, "install")
    commands = [["cmake", "-S", SOURCES, "-B", to + "/build", "-DCMAKE_INSTALL_PREFIX=" + prefix,
                 "-DPYTHON_EXECUTABLE=/usr/bin/python3"],
                ["cmake", "--build", to + "/build"], ["cmake", "--install", to + "/build"]]
    for command in commands:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True)
        if done.returncode != 0:
            raise AssertionError("%s\n%s" % (" ".join(command), done.stdout[-4000:]))
    environment = dict(os.environ)
    for name, path in (("CMAKE_PREFIX_PATH", prefix), ("ROS_PACKAGE_PATH", prefix + "/share"),
                       ("LD_LIBRARY_PATH", prefix + "/lib")):
        environment[name] = path + ":" + environment.get(name, "")
    return environment


def state_of(bodies, name):
    return next(body for body in bodies if body.name == name)


class Plugins(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.environment = build(cls.folder.name)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def tearDown(self):
        Listener.stop_all()

    def node(self, **parameters):
        given = dict(plugins=PLUGIN, paused="true", scene=os.path.join(SOURCES, "scene.yaml"))
        given.update(parameters)
        return running(node_command(**given), env=self.environment)

    def test_wind_is_the_closed_form_and_the_bowl_holds(self):
        with self.node():
            properties()
            readings = []
            topic = rospy.Subscriber(NODE + "/weather/anemometer", Float64, readings.append,
                                     queue_size=1000)
            wait_until(lambda: topic.get_num_connections() > 0, "the sensor")
            answer = call("step", steps=200)
            self.assertTrue(answer.success, answer.status_message)
            ball = state_of(answer.bodies, "ball").twist.linear
            left = math.exp(-0.4 * 2.0 / 0.5)
            self.assertAlmostEqual(ball.x, 3.0 * (1.0 - left), delta=1e-8)
            self.assertAlmostEqual(ball.z, -0.5 * 9.81 / 0.4 * (1.0 - left), delta=1e-8)
            bead = state_of(answer.bodies, "bead").pose.position
            self.assertAlmostEqual(bead.z, (bead.x - 5.0) ** 2 + bead.y ** 2, delta=1e-10)
            wait_until(lambda: len(readings) == 200, "a reading a step")
            self.assertAlmostEqual(readings[-1].data, math.hypot(ball.x, ball.z), delta=1e-12)

    def test_services_add_save_and_restore_them(self):
        with self.node():
            properties()
            refused = call("add_constraint", constraint=Constraint(
                name="gust", type="custom_force:weather/storm", body_b="bead"))
            self.assertFalse(refused.success)
            self.assertIn("no plugin has a force of type 'weather/storm'; types are: weather/bowl,"
                          " weather/lightning, weather/wind", refused.status_message)
            wrong = call("add_constraint", constraint=Constraint(
                name="gust", type="custom_force:weather/wind", body_b="bead",
                parameters=[Parameter("drag", 1.0)]))
            self.assertFalse(wrong.success)
            self.assertIn("'speed' is left out", wrong.status_message)
            added = call("add_constraint", constraint=Constraint(
                name="gust", type="custom_force:weather/wind", body_b="bead",
                parameters=[Parameter("drag", 0.2), Parameter("speed", -1.0)]))
            self.assertTrue(added.success, added.status_message)
            call("step", steps=10)
            text = call("save_scene").text
            self.assertIn("custom: weather/wind", text)
            saved = call("save_snapshot", name="there")
            after = call("step", steps=50).state_hash
            self.assertTrue(call("restore_snapshot", name="there").success)
            self.assertEqual(properties().state_hash, saved.state_hash)
            self.assertEqual(call("step", steps=50).state_hash, after)
            self.assertTrue(call("load_scene", text=text).success)
            self.assertEqual(call("save_scene").text.count("custom: weather"), 3)

    def test_a_recorded_run_is_replayed_with_them_and_refused_without(self):
        log = []
        rospy.Subscriber(NODE + "/edit_log", EditRecord, log.append, queue_size=1000)
        with self.node():
            properties()
            wait_until(lambda: log, "the world that the log begins with")
            call("step", steps=150)
            last = call("set_options", keys=["iterations"], values=["11"])
            self.assertTrue(last.success, last.status_message)
            wait_until(lambda: log[-1].service == "set_options", "the last record")
        file = os.path.join(self.folder.name, "run.bag")
        with rosbag.Bag(file, "w") as bag:
            for i, record in enumerate(log):
                bag.write(NODE + "/edit_log", record, rospy.Time(1 + i))
        said = []
        for options in ([], ["--plugins", PLUGIN], ["--plugins", "none/such"]):
            done = subprocess.run(["rosrun", "constraint_sim", "replay", file, *options],
                                  env=self.environment, stdout=subprocess.PIPE, timeout=60,
                                  stderr=subprocess.STDOUT, universal_newlines=True)
            said.append((done.returncode, done.stdout))
        self.assertEqual(said[0][0], 2)
        self.assertIn("no plugin has a force of type 'weather/wind'", said[0][1])
        self.assertEqual(said[1][0], 0, said[1][1])
        self.assertIn("150 steps: the same hash at each record", said[1][1])
        self.assertEqual(said[2][0], 2)
        self.assertIn("none/such", said[2][1])

    def test_what_fails_is_told_by_its_name(self):
        with self.node():
            properties()
            self.assertTrue(call("add_constraint", constraint=Constraint(
                name="gust", type="custom_force:weather/wind", body_b="bead",
                parameters=[Parameter("drag", 0.2), Parameter("speed", 1.0), Parameter("until", 0.055)])).success)
            answer = call("step", steps=20)
            self.assertFalse(answer.success)
            self.assertIn("'gust' of type 'weather/wind': wrench threw: the wind is over",
                          answer.status_message)
            self.assertTrue(properties().paused)
            self.assertTrue(call("remove_constraint", name="gust").success)
            self.assertTrue(call("step", steps=20).success)

    def test_what_is_no_exception_of_the_standard_library_ends_no_process(self):
        with self.node():
            properties()
            flash = Constraint(name="flash", type="custom_force:weather/lightning", body_b="bead")
            added = call("add_constraint", constraint=flash)
            self.assertTrue(added.success, added.status_message)
            answer = call("step", steps=1)
            self.assertFalse(answer.success)
            self.assertIn("'flash' of type 'weather/lightning': wrench threw", answer.status_message)
            self.assertTrue(call("remove_constraint", name="flash").success)
            self.assertTrue(call("step", steps=1).success)

    def test_a_sensor_that_throws_is_not_called_again(self):
        log, readings = Listener("/rosout", Log), Listener(NODE + "/weather/anemometer", Float64)
        with self.node(**{"weather/anemometer_breaks_at": 0.095}):
            properties()
            wait_until(lambda: log.is_connected() and readings.is_connected(), "the log and the sensor")
            answer = call("step", steps=30)
            self.assertTrue(answer.success, answer.status_message)
            log.find(lambda m: "plugin %s threw and is not called again" % PLUGIN in m.msg, "the error")
            self.assertTrue(call("step", steps=1).success)
            wait_until(lambda: len(readings.messages) >= 9, "a reading a step until then")
            self.assertEqual(len(readings.messages), 9)

    def test_a_class_that_is_not_there_ends_the_node(self):
        for plugins, scene in (("none/such", ""), ("", os.path.join(SOURCES, "scene.yaml"))):
            command = node_command(**{"plugins": plugins or " ", "scene": scene or "pendulum"})
            done = subprocess.run(command, env=self.environment, timeout=3 * TIMEOUT,
                                  stderr=subprocess.PIPE, universal_newlines=True)
            self.assertEqual(done.returncode, 2)
            self.assertIn("none/such" if plugins else "no plugin has a force of type 'weather/wind'",
                          done.stderr)


if __name__ == "__main__":
    rospy.init_node("test_plugins")
    rostest.rosrun("constraint_sim", "plugins", Plugins)
