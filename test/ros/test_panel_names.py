#!/usr/bin/env python3
"""The panel beside a simulator of another name, as the launch file starts both: its fields have the node and
the scene that run, and not those of the shipped configuration."""
import contextlib
import os
import subprocess
import threading
import unittest

import rospy
import rostest

from support import call, node_program, running, wait_until

SIMULATOR = "/robot/sim"


class PanelNames(unittest.TestCase):
    def test_fields_have_the_names_of_what_runs(self):
        fields = {}

        def follow(output):
            for line in output:
                name, _, text = line.rstrip("\n").partition("\t")
                fields[name] = text

        def expect(field, text):
            wait_until(lambda: fields.get(field) == text, "%s: %s" % (field, text), 60)

        with contextlib.ExitStack() as stack:
            stack.enter_context(running([node_program(), "__ns:=/robot", "__name:=sim",
                                         "_scene:=winch", "_paused:=true"]))
            panel = stack.enter_context(running(
                [os.environ["PANEL_FIELDS"], "__ns:=/robot", "__name:=rviz", "/constraint_sim:=sim"],
                stdout=subprocess.PIPE, universal_newlines=True))
            reader = threading.Thread(target=follow, args=(panel.stdout,), daemon=True)
            reader.start()
            expect("Node", SIMULATOR)
            expect("Scene name", "winch")
            self.assertTrue(call(SIMULATOR + "/load_scene", path="bridge").success)
            expect("Scene name", "bridge")


if __name__ == "__main__":
    rospy.init_node("test_panel_names")
    rostest.rosrun("constraint_sim", "panel_names", PanelNames)
