#!/usr/bin/env python3
"""config/parameters.yaml against the node: the same parameters, defaults and types."""
import os
import unittest

import rospkg
import rospy
import rostest
import yaml

import support
from support import node_command, properties, running

FILE = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "config", "parameters.yaml")


def effective(**given):
    """Name -> type and value of what a node with these parameters says it runs with."""
    with running(node_command(**given)):
        properties()  # it is up
        return typed(rospy.get_param(support.NODE))


def typed(parameters):
    return {name: (type(value).__name__, value) for name, value in parameters.items()}


class Parameters(unittest.TestCase):
    def setUp(self):
        with open(FILE) as file:
            self.documented = yaml.safe_load(file)

    def test_file_and_code_have_the_same_defaults(self):
        self.assertEqual(effective(), typed(self.documented))

    def test_a_node_given_the_file_runs_with_it(self):
        # roslaunch leaves out what is empty on a command line, and so does this
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
                 "follow_delay": 0.5}
        self.assertEqual(set(given) | {"plugins"}, set(self.documented))  # test_plugins has one
        self.assertEqual(effective(**given), typed({**given, "plugins": ""}))


if __name__ == "__main__":
    rospy.init_node("test_parameters")
    rostest.rosrun("constraint_sim", "parameters", Parameters)
