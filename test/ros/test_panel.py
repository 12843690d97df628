#!/usr/bin/env python3
"""The panel in rviz on a virtual display: each button has the effect of its service."""
import glob
import os
import shutil
import subprocess
import time

import numpy
import rosbag
import rosnode
import rospy
import rostest
from constraint_sim.msg import EditRecord
from constraint_sim.srv import SetOptionsRequest
from std_msgs.msg import String

import support
from in_rviz import START, read_view
from support import NODE, Listener, call, properties, wait_until
from with_panel import PANEL, PANEL_TOPICS, WithPanel, changed, topics_of_panel

ALWAYS = {NODE + "/statistics", NODE + "/scene"}  # topics that no tab needs
ROW = "bodies:\n" + "".join(
    "- {name: b%d, mass: 1, shape: {box: {size: [1, 1, 1]}}, position: [%d, 0, 0]}\n" % (x, x)
    for x in range(0, 101, 4))


def is_whole_and_large(view):
    """Returns whether bodies in their blue fill a third of the view's width or height, without touching a
    border."""
    is_blue = view[..., 2] - view[..., 0] > 30
    if is_blue[0].any() or is_blue[-1].any() or is_blue[:, 0].any() or is_blue[:, -1].any():
        return False
    return any(seen.any() and numpy.ptp(numpy.flatnonzero(seen)) > seen.size / 3
               for seen in (is_blue.any(axis=0), is_blue.any(axis=1)))


class Panel(WithPanel):
    def setUp(self):
        call("pause_physics")
        self.assertTrue(call("load_scene", path="winch").success)
        call("reset_simulation")
        self.assertTrue(call("step", steps=20).success)
        self.assertTrue(call("save_snapshot", name="base").success)

    def expect_same(self, service, act, **fields):
        """Expects that `act` in the panel leads to the same world as the service."""
        answer = call(service, **fields)
        self.assertTrue(getattr(answer, "success", True))
        expected = properties()
        before = call("restore_snapshot", name="base").state_hash
        self.assertNotEqual(expected.state_hash, before)  # else no effect would show
        act()
        self.wait_for_hash(expected.state_hash, "the world of " + service)
        self.assertEqual(properties().step, expected.step)
        self.wait_for_message(service)

    def test_step(self):
        self.enter("Number of steps", "7")
        self.expect_same("step", lambda: self.click("Step"), steps=7)

    def test_resets(self):
        self.expect_same("reset_world", lambda: self.click("Reset world"))
        self.expect_same("reset_simulation", lambda: self.click("Reset all"))
        self.assertEqual(properties().step, 0)

    def test_play_and_pause(self):
        start = properties().step
        self.click("Play")
        wait_until(lambda: properties().step > start + 50, "steps", START)
        self.click("Pause")
        wait_until(lambda: properties().paused, "the pause", START)
        reached = properties()
        call("restore_snapshot", name="base")
        self.assertEqual(call("step", steps=reached.step - start).state_hash, reached.state_hash)

    def test_load(self):
        def load():
            self.enter("Scene name", "pendulum")
            self.click("Load")
        self.expect_same("load_scene", load, path="pendulum")
        self.assertEqual(properties().bodies, ["bob"])

    def test_the_box_has_the_scene_that_runs(self):
        def expect(name):
            wait_until(lambda: self.widget("Scene name").text() == name, "the scene " + name, START)
        self.click("Plots")  # the field has no focus then
        for name in ("bridge", "winch"):
            self.assertTrue(call("load_scene", path=name).success)
            expect(name)
        self.enter("Scene name", "what_i_type")
        self.click("Plots")
        self.assertTrue(call("load_scene", path="bridge").success)
        wait_until(lambda: self.panel.find_containing("bodies %d," % len(properties().bodies)),
                   "the bridge", START)
        expect("what_i_type")
        self.enter("Scene name", "winch")
        self.click("Load")
        self.wait_for_message("load_scene winch")
        expect("winch")

    def test_what_is_refused_is_said(self):
        answer = call("load_scene", path="no_such_scene")
        self.assertFalse(answer.success)
        before = properties().state_hash
        self.enter("Scene name", "no_such_scene")
        self.click("Load")
        self.wait_for_message(answer.status_message)
        self.assertEqual(properties().state_hash, before)

    def test_save(self):
        path = os.path.join(self.folder, "saved.yaml")
        self.enter("Scene file", path)
        self.click("Save")
        wait_until(lambda: os.path.exists(path), "the file", START)
        with open(path) as file:
            self.assertEqual(file.read(), call("save_scene").text)

    def test_rewind(self):
        kept = len(call("list_snapshots").names)
        base = properties().state_hash
        self.click("Keep")
        wait_until(lambda: len(call("list_snapshots").names) == kept + 1, "a snapshot", START)
        name = call("list_snapshots").names[-1]
        self.assertEqual(call("list_snapshots").state_hashes[-1], base)
        self.wait_for_message("save_snapshot")
        wait_until(lambda: self.panel.find_containing(name + ":"), "its name", START)
        self.assertNotEqual(call("step", steps=5).state_hash, base)
        self.click("Rewind")
        self.wait_for_hash(base, "the rewound world")
        self.assertEqual(properties().step, 20)

    def test_snapshots_are_kept_while_the_world_runs(self):
        first = call("list_snapshots").names
        self.enter("Snapshot interval", "0.2")
        self.click("Play")
        wait_until(lambda: len(set(call("list_snapshots").names) - set(first)) > 2, "three", START)
        self.enter("Snapshot interval", "0")

    def test_speed(self):
        log = Listener(NODE + "/edit_log", EditRecord)
        log.find(what="its first record")
        for factor in ("0.25", "1"):
            self.enter("Real-time factor", factor)
            record = wait_until(lambda: next((m for m in log.messages if m.service == "set_options"),
                                             None), "the option", START)
            request = SetOptionsRequest()
            request.deserialize(bytes(record.request))
            self.assertEqual((request.keys, request.values), (["real_time_factor"], [factor]))
            del log.messages[:]

    def test_motor(self):
        def bias(value):
            return dict(name="rope", keys=["bias"], values=[value])
        self.click("Motors")
        self.widgets.pop("Motor rope", None)
        self.expect_same("set_constraint_properties", lambda: self.enter("Motor rope", "0.1"),
                         **bias(0.1))
        call("restore_snapshot", name="base")

        def slide():
            self.click("Motor slider rope")
            self.keys("Home")  # the left end
        self.expect_same("set_constraint_properties", slide, **bias(-1.0))

    def test_tabs_subscribe_to_what_they_show(self):
        self.click("Plots")
        wait_until(lambda: topics_of_panel() == ALWAYS, "the topic of plots", START)
        self.click("World")
        wait_until(lambda: topics_of_panel() == PANEL_TOPICS, "those of the tree", START)
        for name in ("load", "rope"):
            self.assertIsNotNone(wait_until(lambda: self.panel.find(name), name, START))
        self.click("Plots")
        wait_until(lambda: topics_of_panel() == ALWAYS, "the topic of plots again", START)
        self.keys("alt+p")  # the menu Panels: the panel is the last of the list
        self.hide_and_show()

    def hide_and_show(self):
        self.keys("Up", "Return")
        wait_until(lambda: not topics_of_panel(), "silence of a hidden panel", START)
        self.keys("alt+p", "Up", "Return")
        wait_until(lambda: topics_of_panel() == ALWAYS, "the panel again", START)

    def test_record(self):
        prefix = os.path.join(self.folder, "run")
        self.enter("Bag", prefix)
        self.click("Record")
        wait_until(lambda: glob.glob(prefix + "*.bag.active"), "the recorder", START)
        wait_until(lambda: self.recorders(), "its subscription", START)
        self.assertTrue(call("step", steps=9).success)
        self.click("Stop recording")
        bags = wait_until(lambda: glob.glob(prefix + "*.bag"), "the bag", START)
        self.wait_for_message("recorded " + bags[0])
        with rosbag.Bag(bags[0]) as bag:
            records = [m for _, m, _ in bag.read_messages([NODE + "/edit_log"])]
        self.assertEqual(records[0].service, "snapshot")
        self.enter("Bag", os.path.join(self.folder, "missing", "run"))
        self.click("Record")
        self.wait_for_message("No such file or directory")

    def recorders(self):
        topics = {}
        for name in subprocess.check_output(["rosnode", "list"], universal_newlines=True).split():
            if name.startswith("/record"):
                topics[name] = support.topics_between(NODE, name)
        return any(NODE + "/edit_log" in connected for connected in topics.values())

    def test_buttons_stay_where_they_are(self):
        """Otherwise a click would miss a button while the state's text has more lines."""
        wait_until(lambda: self.panel.find_containing("paused at"), "the short text", START)
        places = {name: self.widget(name).centre() for name in ("Play", "Load", "Record")}
        self.assertTrue(call("load_scene", path="bridge").success)
        call("unpause_physics")
        wait_until(lambda: self.panel.find_containing("; speed "), "the long text", START)
        for name, place in places.items():
            self.assertEqual(self.widget(name).centre(), place, name)

    def settled(self, condition=lambda view: True, what="a view that is still"):
        """Returns the view beside the panel, once it is equal three times and meets the condition."""
        views = []

        def is_settled():
            views.append(read_view(self.screenshot("settled.png"))[20:, :PANEL])
            return (len(views) > 2 and all((views[-1] == view).all() for view in views[-3:-1]) and
                    condition(views[-1]))
        support.wait_until(is_settled, what, START)
        return views[-1]

    def framed(self):
        return self.settled(is_whole_and_large, "a view that is whole and large")

    def test_a_scene_that_is_loaded_is_framed(self):
        """Loads by the panel, and by the service."""
        self.enter("Scene name", "gripper")
        self.click("Load")  # 0.1 m large
        self.framed()
        self.assertTrue(call("load_scene", text=ROW).success)  # 100 m long
        self.framed()
        self.assertTrue(call("load_scene", path="gripper").success)
        self.framed()

    def test_many_loads_leave_no_dead_nodes(self):
        """Each load fits the view, in place of the fit before it, by a process that is a node for a moment."""
        for i in range(200):
            self.assertTrue(call("load_scene", path=("gripper", "pendulum")[i % 2]).success)
            time.sleep(0.004 * (i % 50))  # at any moment of the fit before
        self.assertTrue(call("load_scene", path="gripper").success)
        self.framed()

        def left():
            return [name for name in rosnode.get_node_names() if "rviz_config" in name]
        wait_until(lambda: not left(), "no node of a fit", START)

    def test_the_view_stays_where_the_user_has_it(self):
        self.assertTrue(call("load_scene", text=ROW).success)
        self.framed()
        self.assertTrue(call("load_scene", path="gripper").success)
        first = self.framed()
        self.xdotool("mousemove", 120, 300, "mousedown", 1)
        for x in range(120, 220, 10):
            self.xdotool("mousemove", x, 300 + x // 2)
        self.xdotool("mouseup", 1, "mousemove", 120, 300)
        for _ in range(12):
            self.xdotool("click", 5)  # farther away
        moved = self.settled(lambda view: changed(first, view) > 0.02)
        scenes = Listener(NODE + "/scene", String)
        self.assertEqual(scenes.find(what="the scene").data, "gripper")
        self.assertTrue(call("save_snapshot", name="gripper").success)
        self.assertTrue(call("add_body", body=support.sphere("far", 100.0)).success)
        self.assertTrue(call("restore_snapshot", name="gripper").success)
        self.click("Reset all")
        self.wait_for_message("reset_simulation")
        self.settled(lambda view: changed(moved, view) < 0.002, "the user's view")  # texts are redrawn
        self.assertEqual(len(scenes.messages), 1)

    def test_all_at_a_glance(self):
        """Takes the pictures of README.md and docs/hands_and_panel.md."""
        self.enter("Scene name", "bridge")
        self.click("Load")
        wait_until(lambda: "ball_1" in properties().bodies, "the bridge", START)
        self.click("Play")
        self.click("Plots")
        statistics = Listener(NODE + "/statistics", rospy.AnyMsg)
        wait_until(lambda: len(statistics.messages) > 60, "a part of the plot", START)
        self.assertGreater(os.path.getsize(self.screenshot("rviz.png")), 0)


if __name__ == "__main__":
    rospy.init_node("test_panel")
    if not shutil.which("xdotool"):
        raise SystemExit("xdotool is needed: scripts/setup")
    rostest.rosrun("constraint_sim", "panel", Panel)
