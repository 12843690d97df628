#!/usr/bin/env python3
"""Neither a node nor rviz that ends while the panel calls hangs the other."""
import shutil
import signal

import rospy
import rostest

import support
from in_rviz import START
from support import call, node_command, properties, wait_until
from test_hostile import ENDLESS
from with_panel import WithPanel


class PanelEnds(WithPanel):
    """In the order of their names: the last one ends rviz."""

    @classmethod
    def configuration(cls):
        """Without the pictures of bodies: hundreds of them take rviz a second each time."""
        text = super().configuration()
        for topic in ("markers", "labels"):
            text = text.replace("/constraint_sim/" + topic, "/constraint_sim/no_" + topic)
        return text

    def test_1_a_node_that_ends_in_a_call_is_reported(self):
        self.node.send_signal(signal.SIGSTOP)
        self.click("Step")
        wait_until(lambda: self.panel.find_containing("waiting for"), "that it waits", START)
        self.node.send_signal(signal.SIGKILL)
        self.node.wait()
        self.wait_for_message("the node went away during the call")
        wait_until(lambda: self.panel.find_containing("no contact"), "no contact", START)
        self.click("Pause")
        self.wait_for_message("pause_physics: the node is gone")

    def test_2_a_node_that_comes_back_is_found(self):
        type(self).node = self.outer.enter_context(
            support.running(node_command(scene="pendulum", paused=True, hands=False,
                                         publish_tf=False)))
        before = properties()
        wait_until(lambda: self.panel.find_containing("paused at"), "contact", START)
        self.click("Step")
        wait_until(lambda: properties().step == before.step + 1, "the step", START)

    def test_3_rviz_ends_while_calls_wait(self):
        self.assertTrue(call("load_scene", text=ENDLESS).success)
        call("unpause_physics")
        self.click("Pause")  # answered, or not
        self.click("Play")
        self.node.send_signal(signal.SIGSTOP)  # from here on nothing is answered
        try:
            self.click("Step")
            self.click("Load")
            self.rviz.send_signal(signal.SIGINT)
            self.rviz.wait(timeout=START)  # far beyond what it takes: it would wait for ever
        finally:
            self.node.send_signal(signal.SIGCONT)
        call("pause_physics")
        self.assertIsNone(self.node.poll())


if __name__ == "__main__":
    rospy.init_node("test_panel_ends")
    if not shutil.which("xdotool"):
        raise SystemExit("xdotool is needed: scripts/setup")
    rostest.rosrun("constraint_sim", "panel_ends", PanelEnds)
