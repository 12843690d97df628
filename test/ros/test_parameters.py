#!/usr/bin/env python3
"""config/parameters.yaml against the node: the same parameters, defaults and types."""
import os
import subprocess
import unittest

import rospkg
import rospy
import rostest
import yaml

import support
from support import node_command, properties, running

FILE = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "config", "parameters.yaml")


def effective(**given):
    """Returns name -> type and value of the effective parameters of a node started with these."""
    with running(node_command(**given)):
        properties()  # the node is up
        found = rospy.get_param(support.NODE)
        found.pop("robots", None)  # descriptions of the robots that were loaded
        return typed(found)


def typed(parameters):
    return {name: (type(value).__name__, value) for name, value in parameters.items()}


class Parameters(unittest.TestCase):
    def setUp(self):
        with open(FILE) as file:
            self.documented = yaml.safe_load(file)

    def test_file_and_code_have_the_same_defaults(self):
        self.assertEqual(effective(), typed(self.documented))

    def test_a_node_given_the_file_runs_with_it(self):
        # roslaunch leaves out empty values on a command line, and so does this
        given = {name: value for name, value in self.documented.items() if value != ""}
        self.assertEqual(effective(**given), typed(self.documented))

    def test_what_is_given_is_what_it_runs_with(self):
        given = {"scene": "pendulum", "time_step": 0.002, "real_time_factor": 0.5,
                 "publish_rate": 20.0, "publish_tf": False, "publish_clock": True, "paused": True, "world_frame": "map",
                 "frame_prefix": "left/", "closing_time": 0.25, "scene_folder": "/tmp",
                 "hands": False, "diagnostics_real_time_factor": 0.5,
                 "diagnostics_constraint_error": 0.01,
                 "robot": "gripper", "robot_extra": "package://constraint_sim/config/robots/gripper.yaml",
                 "robot_prefix": "left/", "robot_fixed": True, "robot_x": 1.0, "robot_y": 2.0,
                 "robot_z": 3.0, "publish_links": "root", "publish_com": True, "command": "a b",
                 "cmd_vel": "c", "wrench": "d", "odometry": "e", "follow": "f=g",
                 "follow_delay": 0.5, "goal_tolerance": 0.02, "goal_time_tolerance": 0.5}
        self.assertEqual(set(given) | {"plugins"}, set(self.documented))  # test_plugins tests it
        self.assertEqual(effective(**given), typed({**given, "plugins": ""}))

    # ---- the command line

    def end_of(self, *words):
        """Returns exit status and output of a node that must not start."""
        done = subprocess.run([support.node_program(), "__name:=constraint_sim", *words],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True, timeout=support.TIMEOUT)
        return done.returncode, done.stdout

    def test_help_is_shown_and_no_node_starts(self):
        for word in ("--help", "-h"):
            status, said = self.end_of(word)
            self.assertEqual(status, 0)
            for name in self.documented:
                self.assertIn(" " + name, said)

    def test_words_that_are_no_parameters_are_named(self):
        for words, named in ((["bridge"], "'bridge'"), (["--scene", "bridge"], "bridge"),
                             (["scene:=bridge"], "_scene:=VALUE"), ([":=bridge"], ":=bridge"),
                             (["_paused:=true", "real_time_factor:=0"], "_real_time_factor")):
            status, said = self.end_of(*words)
            self.assertEqual(status, 2, said)
            self.assertIn(named, said)

    def test_a_remap_from_roslaunch_is_none_of_them(self):
        with running(node_command(paused="true") + ["cmd_vel:=base/cmd_vel", "__log:=/tmp/none.log"]):
            self.assertEqual(properties().bodies, [])

    def test_names_with_empty_parts_are_refused(self):
        for given in ("_command:=a//b/", "_cmd_vel:=/a", "_wrench:=a/", "_odometry:=a//b",
                      "_world_frame:=map//", "_frame_prefix:=a//", "_robot_prefix:=/a",
                      "_follow:=a=b//c"):
            status, said = self.end_of(given)
            self.assertEqual(status, 2, said)
            self.assertIn("parameter ~" + given[1:given.index(":=")], said)

    def test_names_of_one_topic_are_refused(self):
        for given in ("_command:=wrist-1 wrist_1", "_cmd_vel:=wrist_1 a wrist.1", "_wrench:=a.b-c a-b.c",
                      "_odometry:=a/b-c a/b_c", "_command:=a b a"):
            kind, names = given[1:].split(":=")
            status, said = self.end_of(given)
            self.assertEqual(status, 2, said)
            self.assertIn("parameter ~" + kind, said)
            first, last = names.split()[0], names.split()[-1]
            if first == last:
                self.assertIn("'%s' twice" % first, said)
            else:
                topic = first.replace("-", "_").replace(".", "_")
                for part in ("'%s' and '%s'" % (first, last), "%s/%s" % (kind, topic)):
                    self.assertIn(part, said)

    def test_values_of_another_type_are_shown_as_they_are(self):
        for value, shown in (([1, 2], "a list"), ({"a": 1}, "a map"), ("fast", "'fast'"), (True, "true")):
            rospy.set_param(support.NODE + "/time_step", value)
            status, said = self.end_of()
            rospy.delete_param(support.NODE)
            self.assertEqual(status, 2, said)
            self.assertIn("must be a number, got " + shown, said)
            self.assertNotIn("<", said)

    def test_paths_of_robots_are_no_names_of_parameters(self):
        for path in ("/any/path/arm.urdf", "package://nowhere/arm-1.urdf", "arm 1"):
            status, said = self.end_of("_robot:=" + path)
            self.assertEqual(status, 2, said)
            self.assertIn("parameter ~robot", said)

    def test_what_a_command_line_gave_is_of_that_run_alone(self):
        given = {"real_time_factor": 0, "time_step": 0.002, "paused": True}
        before = effective()
        with running(node_command(**given, colour="red")):
            properties()
            rospy.set_param(support.NODE + "/time_step", 0.004)  # by another process
        left = rospy.get_param(support.NODE)
        self.assertEqual(set(left) & {"real_time_factor", "paused", "colour"}, set())
        self.assertEqual(left["time_step"], 0.004)
        rospy.delete_param(support.NODE + "/time_step")
        with running([support.node_program(), "__name:=constraint_sim"]):
            properties()
            self.assertEqual(typed(rospy.get_param(support.NODE)), before)
        # also where the node does not start
        self.assertEqual(self.end_of("_paused:=true", "_time_step:=-1")[0], 2)
        self.assertEqual(set(rospy.get_param(support.NODE)) & {"time_step", "paused"}, set())


if __name__ == "__main__":
    rospy.init_node("test_parameters")
    rostest.rosrun("constraint_sim", "parameters", Parameters)
