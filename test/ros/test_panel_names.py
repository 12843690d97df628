#!/usr/bin/env python3
"""The panel beside a simulator of another name, as the launch file starts both: its fields have the node and
the scene that run, and not those of the shipped configuration."""
import contextlib
import os
import subprocess
import tempfile
import unittest

import rospy
import rostest

import accessible
from in_rviz import PACKAGE, START, environment_on, virtual_display, with_few_pictures
from support import call, node_program, running, topics_between, wait_until

SIMULATOR = "/robot/sim"


class PanelNames(unittest.TestCase):
    def test_fields_have_the_names_of_what_runs(self):
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            display = stack.enter_context(virtual_display())
            environment = environment_on(display, folder)
            bus = stack.enter_context(accessible.session(environment))
            stack.enter_context(running([node_program(), "__ns:=/robot", "__name:=sim",
                                         "_scene:=winch", "_paused:=true"]))
            config = os.path.join(folder, "view.rviz")
            with open(os.path.join(PACKAGE, "config", "constraint_sim.rviz")) as shipped, open(config, "w") as file:
                file.write(with_few_pictures(shipped.read()))
            stack.enter_context(running(
                ["rviz", "-d", config, "__ns:=/robot", "__name:=rviz", "/constraint_sim:=sim"], env=environment,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
            wait_until(lambda: topics_between(SIMULATOR, "/robot/rviz"), "rviz", START)
            desktop = accessible.Desktop(bus)
            panel = wait_until(lambda: desktop.root.find("Simulator"), "the panel", START)

            def expect(field, text):
                widget = wait_until(lambda: panel.find(field), field, START)
                wait_until(lambda: widget.text() == text, "%s: %s" % (field, text), START)
            expect("Node", SIMULATOR)
            expect("Scene name", "winch")
            self.assertTrue(call(SIMULATOR + "/load_scene", path="bridge").success)
            expect("Scene name", "bridge")


if __name__ == "__main__":
    rospy.init_node("test_panel_names")
    rostest.rosrun("constraint_sim", "panel_names", PanelNames)
