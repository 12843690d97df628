#!/usr/bin/env python3
"""Snapshots: exact to the bit, in memory and in files, in one process and in another."""
import os
import tempfile
import threading
import xmlrpc.client

import rosgraph
import rosnode
import rospy
import rostest

import support
from support import call, node_command, properties, running, sphere


def most_memory():
    """Returns the peak resident memory of the node [MiB]."""
    uri = rosnode.get_api_uri(rosgraph.Master(rospy.get_name()), support.NODE)
    pid = xmlrpc.client.ServerProxy(uri).getPid(rospy.get_name())[2]
    with open("/proc/%d/status" % pid) as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM:")) / 1024


class Snapshots(support.ServiceCase):
    def setUp(self):
        support.empty_world()

    def test_500_steps_twice_for_every_shipped_scene(self):
        for scene in self.good("list_scenes").scenes:
            self.good("load_scene", path=scene)
            self.good("step", steps=100)
            saved = self.good("save_snapshot", name="here")
            self.assertEqual(saved.state_hash, properties().state_hash, scene)
            first = self.good("step", steps=500).state_hash
            restored = self.good("restore_snapshot", name="here")
            self.assertEqual((restored.state_hash, restored.step), (saved.state_hash, saved.step))
            self.assertEqual(properties().state_hash, saved.state_hash, scene)
            self.assertEqual(self.good("step", steps=500).state_hash, first, scene)

    def test_in_another_process(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "winch.snapshot")
            self.good("load_scene", path="winch")
            self.good("step", steps=150)
            self.good("save_snapshot", path=file)
            expected = self.good("step", steps=500).state_hash
            command = [word.replace("__name:=constraint_sim", "__name:=other")
                       for word in node_command(paused="true")]
            with running(command):
                answer = call("/other/restore_snapshot", path=file)
                self.assertTrue(answer.success, answer.status_message)
                self.assertEqual(call("/other/step", steps=500).state_hash, expected)
            with open(file, "r+b") as damaged:
                damaged.seek(1000)
                damaged.write(b"x")
            self.bad(["damaged"], "restore_snapshot", path=file)
            self.bad(["nothing.snapshot"], "restore_snapshot",
                     path=os.path.join(folder, "nothing.snapshot"))

    def test_files_stay_below_the_folder_of_scenes(self):
        with tempfile.TemporaryDirectory() as folder:
            command = [word.replace("__name:=constraint_sim", "__name:=below")
                       for word in node_command(scene_folder=folder)]
            with running(command):
                self.assertTrue(call("/below/save_snapshot", path="mine.snapshot").success)
                self.assertEqual(os.listdir(folder), ["mine.snapshot"])
                self.assertTrue(call("/below/restore_snapshot", path="mine.snapshot").success)
                for name in ("save_snapshot", "restore_snapshot"):
                    for path in ("../mine.snapshot", "/tmp/mine.snapshot"):
                        answer = call("/below/" + name, path=path)
                        self.assertFalse(answer.success)
                        self.assertIn("scene_folder", answer.status_message)

    def test_what_was_added_and_removed_since_comes_back_or_goes(self):
        self.good("add_body", body=sphere("kept"))
        self.good("save_snapshot", name="one")
        self.good("remove_body", name="kept")
        self.good("add_body", body=sphere("newcomer"))
        self.good("set_options", keys=["gravity"], values=["[0, 0, 0]"])
        self.good("restore_snapshot", name="one")
        now = properties()
        self.assertEqual(now.bodies, ["kept"])
        self.assertEqual(now.gravity.z, -9.81)

    def test_a_restore_cancels_waiting_steps(self):
        self.good("load_scene", path="pendulum")
        self.good("save_snapshot", name="start")
        answers = []
        waiting = threading.Thread(target=lambda: answers.append(call("step", steps=4000000000)))
        waiting.start()
        begun = properties().step
        support.wait_until(lambda: properties().step > begun, "the first of many steps")
        self.good("restore_snapshot", name="start")
        waiting.join()
        self.assertFalse(answers[0].success)
        self.assertIn("restore_snapshot", answers[0].status_message)

    def test_the_ring_rewinds(self):
        self.good("load_scene", path="pendulum")
        taken = []
        for _ in range(105):
            taken.append(self.good("save_snapshot"))
            self.good("step", steps=1)
        listed = self.good("list_snapshots")
        ring = [name for name in listed.names if name.startswith("auto_")]
        self.assertEqual(ring, [one.name for one in taken[-100:]])  # the oldest made room
        for one in (taken[-1], taken[50], taken[5]):
            self.good("restore_snapshot", name=one.name)
            now = properties()
            self.assertEqual((now.state_hash, now.step), (one.state_hash, one.step))
        self.bad(["name", taken[4].name], "restore_snapshot", name=taken[4].name)
        index = list(listed.names).index(taken[7].name)
        self.assertEqual((listed.sim_times[index], listed.steps[index],
                          listed.state_hashes[index]),
                         (taken[7].sim_time, taken[7].step, taken[7].state_hash))

    def test_what_cannot_be(self):
        self.bad(["name", "nobody"], "restore_snapshot", name="nobody")
        self.bad(["name, path"], "restore_snapshot")
        self.bad(["name, path"], "restore_snapshot", name="a", path="b")
        self.bad(["name, path"], "save_snapshot", name="a", path="b")
        self.bad(["auto_"], "save_snapshot", name="auto_1")
        self.bad(["/nowhere"], "save_snapshot", path="/nowhere/at/all")
        self.bad(["name", "255", "5000000"], "save_snapshot", name="x" * 5000000)
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as scene:
            scene.write("bodies: []")
            scene.flush()
            self.bad(["snapshot", "none"], "restore_snapshot", path=scene.name)

    def test_large_files_that_are_none_are_not_read(self):
        with tempfile.NamedTemporaryFile(suffix=".snapshot") as file:
            file.truncate(1 << 30)
            before = most_memory()
            callers = [threading.Thread(target=lambda: self.assertIn(
                "snapshot", call("restore_snapshot", path=file.name).status_message))
                for _ in range(4)]
            for caller in callers:
                caller.start()
            for caller in callers:
                caller.join()
            self.assertLess(most_memory() - before, 100.0)

    def test_names_are_replaced(self):
        self.good("save_snapshot", name="again")
        self.good("add_body", body=sphere("ball"))
        second = self.good("save_snapshot", name="again")
        self.assertEqual(list(self.good("list_snapshots").names).count("again"), 1)
        self.assertEqual(self.good("restore_snapshot", name="again").state_hash,
                         second.state_hash)


if __name__ == "__main__":
    rospy.init_node("test_snapshots")
    rostest.rosrun("constraint_sim", "snapshots", Snapshots)
