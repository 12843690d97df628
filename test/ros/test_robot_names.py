#!/usr/bin/env python3
"""Values of `robot`: a path, package://, a parameter's name or a shipped one; on a command line, in a
launch file and as a parameter. A robot of a command line is gone when the node has ended."""
import contextlib
import os
import subprocess
import tempfile
import unittest

import rospkg
import rospy
import rostest

import support
from support import NODE, node_command, properties, running
from test_launch import launched

SHIPPED = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "config", "robots", "arm.urdf")
PACKAGE = "package://constraint_sim/config/robots/arm.urdf"


def description():
    with open(SHIPPED) as file:
        return file.read()


class RobotNames(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        for place in ("my robot-1.2", "home"):
            os.mkdir(os.path.join(self.folder, place))
        self.path = os.path.join(self.folder, "my robot-1.2", "arm-v1.urdf.txt")
        for path in (self.path, os.path.join(self.folder, "home", "arm.urdf"),
                     os.path.join(self.folder, "arm")):
            with open(path, "w") as file:
                file.write(description())
        rospy.set_param("/robot_description", description())
        rospy.set_param("/robots/left", description())
        self.addCleanup(lambda: [rospy.delete_param(name) for name in ("/robot_description", "/robots")])
        with running(node_command(paused=True, robot="arm")):
            self.bodies = properties().bodies
        self.assertGreater(len(self.bodies), 3)

    def names(self):
        """Returns each form that a name can have."""
        return [self.path, os.path.join(self.folder, "arm"), PACKAGE, "/robot_description",
                "robot_description", "robots/left", "~robot_text", "~/arm.urdf", "arm"]

    def environment(self):
        return dict(os.environ, HOME=os.path.join(self.folder, "home"))

    def check_robot(self, name):
        self.assertEqual(properties().bodies, self.bodies, name)

    # ---- that there is

    def test_on_a_command_line(self):
        for name in self.names():
            command = node_command(paused=True, robot=name)
            rospy.set_param(NODE + "/robot_text", description())
            with running(command, env=self.environment()):
                self.check_robot(name)
                self.assertEqual(rospy.get_param(NODE + "/robot"), name)
            self.assertFalse(rospy.has_param(NODE + "/robot"), name)

    def test_on_a_command_line_a_path_that_starts_where_the_node_does(self):
        with running(node_command(paused=True, robot="my robot-1.2/arm-v1.urdf.txt"),
                     cwd=self.folder):
            self.check_robot("a relative path")

    def test_as_a_parameter(self):
        for name in self.names():
            command = node_command()
            rospy.set_param(NODE, {"robot": name, "paused": True, "robot_text": description()})
            with running(command, env=self.environment()):
                self.check_robot(name)
            self.assertEqual(rospy.get_param(NODE + "/robot"), name)  # the value of the process that set it

    def test_in_a_launch_file(self):
        for name in self.names():
            if name[0] == "~":  # the file sets no other parameter, and the home is roslaunch's
                continue
            with launched("simulator.launch", robot=name, paused="true"):
                self.check_robot(name)

    def test_the_scene_beside_it(self):
        with launched("simulator.launch", robot="arm", scene="pendulum", paused="true"):
            self.assertEqual(properties().bodies, ["bob"] + self.bodies)
        with launched("simulator.launch", robot="arm", scene="none", paused="true"):
            self.check_robot("arm")
        with launched("simulator.launch", scene="none"):
            self.assertEqual(properties().bodies, [])
            self.assertTrue(support.call("load_scene", path="pendulum").success)
            self.assertTrue(support.call("load_scene", path="none").success)
            self.assertEqual(properties().bodies, [])
        with running(node_command(robot="arm", scene="none")):
            self.check_robot("arm")
        # roslaunch drops arguments without a value, so the default holds
        with launched("simulator.launch", robot="arm", scene="", paused="true"):
            self.check_robot("arm")

    # ---- that there is not

    def end_of(self, *words):
        """Returns exit status and output of a node that must not start."""
        done = subprocess.run([support.node_program(), "__name:=constraint_sim", *words],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=self.folder,
                              universal_newlines=True, timeout=support.TIMEOUT)
        return done.returncode, done.stdout

    def check_start(self):
        """Expects that a node starts as if no other had run before."""
        with running([support.node_program(), "__name:=constraint_sim", "_paused:=true"]):
            self.assertEqual(properties().bodies, [])

    def test_names_that_nothing_has_end_the_node_and_later_ones_start(self):
        missing = os.path.join(self.folder, "crane.urdf")
        for name, parts in ((missing, [missing, "cannot read"]),
                            ("a.b", ["a.b", "arm gripper quadruped"]),
                            ("quadrupd", ["quadrupd", "did you mean 'quadruped'?"]),
                            ("arm 1", ["arm 1"]), ("~", ["~"]), ("~nothing", ["~nothing"]),
                            ("~a.b", ["~a.b"]), ("~/crane.urdf", ["crane.urdf"]),
                            ("/nothing", ["/nothing"]), ("/robots", ["/robots"]),
                            ("models/crane.urdf", ["relative paths start at " + self.folder]),
                            ("package://nowhere/arm-1.urdf", ["no package 'nowhere'"]),
                            ("package://constraint_sim/../crane.urdf", ["leaves its package"]),
                            ("http://nowhere/crane.urdf", ["http://nowhere/crane.urdf"]), ("7", ["7"])):
            status, said = self.end_of("_robot:=" + name)
            self.assertEqual(status, 2, said)
            for part in ["parameter ~robot: "] + parts:
                self.assertIn(part, said)
            self.assertFalse(rospy.has_param(NODE + "/robot"), name)
            self.assertNotIn("scene:", said)
        self.check_start()

    def test_names_that_no_parameter_can_have_leave_nothing_on_the_master(self):
        # roscpp sets parameters in the order of their names until it reaches the bad one
        for word in ("_zz.z:=1", "_zz-z:=1", "_zz z:=1", "_/zz:=1", "_7:=1"):
            rospy.set_param("/zz", 1)
            status, said = self.end_of("_robot:=arm", "_paused:=true", word)
            self.assertEqual(status, 2, said)
            self.assertIn("'%s'" % word[1:-3], said)
            self.assertEqual(rospy.get_param("/zz"), 1)
            self.assertFalse(rospy.has_param(NODE + "/robot"), word)
        rospy.delete_param("/zz")
        self.check_start()

    def test_a_parameter_of_others_that_cannot_be_is_named_and_stays(self):
        with contextlib.ExitStack() as stack:
            stack.callback(lambda: rospy.delete_param(NODE))
            rospy.set_param(NODE + "/robot", "/any/path/arm-1.urdf")
            status, said = self.end_of()
            self.assertEqual(status, 2, said)
            self.assertIn("rosparam delete %s/robot" % NODE, said)
            self.assertEqual(rospy.get_param(NODE + "/robot"), "/any/path/arm-1.urdf")


if __name__ == "__main__":
    rospy.init_node("test_robot_names")
    rostest.rosrun("constraint_sim", "robot_names", RobotNames)
