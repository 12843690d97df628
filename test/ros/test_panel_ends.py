#!/usr/bin/env python3
"""A node or rviz that ends while the panel makes a call does not hang the other one."""
import os
import shutil
import signal
import subprocess
import time

import rosnode
import rospy
import rostest

import support
from in_rviz import START, read_view
from support import NODE, call, node_command, properties, wait_until
from test_hostile import ENDLESS
from with_panel import PANEL, WithPanel, changed, topics_of_panel


def children_of(process):
    return subprocess.run(["pgrep", "-P", str(process.pid)], stdout=subprocess.PIPE,
                          universal_newlines=True).stdout.split()


def is_alive(process):
    return subprocess.call(["ps", "-p", process], stdout=subprocess.DEVNULL) == 0


class PanelEnds(WithPanel):
    """Tests in the order of their names: the third one ends rviz."""

    @classmethod
    def configuration(cls):
        """Returns a configuration without pictures of bodies: hundreds of them take rviz a second each
        time. The view follows the load of the winch."""
        text = super().configuration()
        for topic in ("markers", "labels"):
            text = text.replace("/constraint_sim/" + topic, "/constraint_sim/no_" + topic)
        assert text.count("Target Frame: <Fixed Frame>") == 1
        return text.replace("Target Frame: <Fixed Frame>", "Target Frame: load")

    def test_0_a_view_that_follows_a_body_stays(self):
        """The view is set by rviz's configuration."""
        wait_until(lambda: NODE + "/scene" in topics_of_panel(), "the panel", START)
        told = "the view stays: it follows load"
        views = []

        def is_still():
            views.append(read_view(self.screenshot("view.png"))[20:, :PANEL])
            return len(views) > 2 and all((views[-1] == view).all() for view in views[-3:-1])
        for count in (1, 2):  # at first rviz may not know the frame
            self.assertTrue(call("load_scene", path="winch").success)
            wait_until(lambda: self.messages().count(told) == count, told, START)
            before = views[-1] if views else None
            wait_until(is_still, "a view that is still", START)
        self.assertLess(changed(before, views[-1]), 0.002)

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

    def test_1_nodes_end_at_any_moment_of_their_start(self):
        """Nodes end while the panel looks for them and calls them."""
        def is_looked_for():
            time.sleep(0.1)  # a moment of its start, before it is known
            return True
        for moment in (lambda: True, is_looked_for, lambda: rosnode.rosnode_ping(NODE, 1),
                       topics_of_panel):
            with support.running(node_command(scene="winch")) as node:
                wait_until(moment, "the moment", START)
                node.send_signal(signal.SIGINT)
                node.wait(timeout=START)

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
        self.node.send_signal(signal.SIGSTOP)  # no calls are answered from here on
        try:
            self.click("Step")
            self.click("Load")
            children = children_of(self.rviz)
            self.assertTrue(children)
            self.rviz.send_signal(signal.SIGINT)
            self.rviz.wait(timeout=START)  # far beyond its time: it would wait for ever
            for child in children:  # it searched for a view of that scene
                wait_until(lambda: not is_alive(child), "the end of what rviz started", START)
        finally:
            self.node.send_signal(signal.SIGCONT)
        call("pause_physics")
        self.assertIsNone(self.node.poll())

    def test_4_rviz_ends_at_any_moment_of_its_start(self):
        """rviz ends while the panel finds the node, and the loaded scene."""
        config = os.path.join(self.folder, "view.rviz")
        for moment in (lambda: True, lambda: "/rviz" in rosnode.get_node_names(), topics_of_panel):
            with support.running(["rviz", "-d", config, "__name:=rviz"], env=self.environment,
                                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as rviz:
                wait_until(moment, "the moment", START)
                self.assertTrue(call("load_scene", path="bridge").success)
                rviz.send_signal(signal.SIGINT)
                rviz.wait(timeout=START)
        self.assertIsNone(self.node.poll())


if __name__ == "__main__":
    rospy.init_node("test_panel_ends")
    if not shutil.which("xdotool"):
        raise SystemExit("xdotool is needed: scripts/setup")
    rostest.rosrun("constraint_sim", "panel_ends", PanelEnds)
