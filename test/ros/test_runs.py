#!/usr/bin/env python3
"""Whole runs of the node: determinism against the runner, a bag, and invalid parameters."""
import glob
import json
import os
import subprocess
import tempfile
import unittest

import rosbag
import rospkg
import rospy
import rostest
from visualization_msgs.msg import Marker

import support
from support import call, node_command, properties, running

SCENES = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "config", "scenes")


class Runs(unittest.TestCase):
    def runner_report(self, scene):
        with tempfile.TemporaryDirectory() as folder:
            report = folder + "/report.json"
            subprocess.check_call(["rosrun", "constraint_sim", "constraint_sim_run", scene,
                                   "--duration", "2", "--report", report],
                                  stdout=subprocess.DEVNULL)
            with open(report) as file:
                return json.load(file)

    def test_the_node_and_the_runner_give_the_same_bits_for_every_shipped_scene(self):
        scenes = sorted(glob.glob(SCENES + "/*.yaml"))
        self.assertGreaterEqual(len(scenes), 10)
        different = []
        for scene in scenes:
            expected = self.runner_report(scene)
            with running(node_command(scene=scene, paused="true")):
                answer = call("step", steps=expected["steps"])
                if answer.state_hash != int(expected["state_hash"], 16):
                    different.append(scene)
        self.assertEqual(different, [])

    def test_a_recorded_bag_reads_back(self):
        topics = ["/tf"] + [support.NODE + "/" + name for name in
                            ("markers", "body_states", "constraint_states", "statistics")]
        with tempfile.TemporaryDirectory() as folder:
            bag_path = folder + "/run.bag"
            with running(node_command(scene="double_pendulum")):
                call("pause_physics")
                with running(["rosbag", "record", "-O", bag_path] + topics + ["__name:=recorder"]):
                    support.wait_until(lambda: support.topics_between(support.NODE, "/recorder") >=
                                       set(topics), "the recorder")
                    call("unpause_physics")
                    first = properties().sim_time
                    support.wait_until(lambda: properties().sim_time > first + 2.0, "2 s")
                support.wait_until(lambda: os.path.exists(bag_path), "the closed bag")
            with rosbag.Bag(bag_path) as bag:
                found = bag.get_type_and_topic_info().topics
                self.assertEqual(sorted(found), sorted(topics))
                places = [m.transforms[-1].transform.translation.x
                          for _, m, _ in bag.read_messages("/tf")]
                first_markers = next(m for _, m, _ in bag.read_messages(topics[1]))
                steps = [m.step for _, m, _ in
                         bag.read_messages(support.NODE + "/statistics")]
            self.assertEqual(first_markers.markers[0].action, Marker.DELETEALL)
            self.assertGreater(max(places) - min(places), 0.01)
            self.assertEqual(steps, sorted(steps))

    def check_refused(self, words, **parameters):
        done = subprocess.run(node_command(**parameters), stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, universal_newlines=True,
                              timeout=support.TIMEOUT)
        self.assertEqual(done.returncode, 2, done.stdout)
        for word in words:
            self.assertIn(word, done.stdout)

    def test_parameters_that_cannot_be_end_the_node_with_status_2(self):
        self.check_refused(["~time_step", "-1"], time_step=-1)
        self.check_refused(["~time_step", "fast"], time_step="fast")
        self.check_refused(["~real_time_factor", "-0.5"], real_time_factor=-0.5)
        self.check_refused(["~publish_rate", "0"], publish_rate=0)
        self.check_refused(["~world_frame", "/map"], world_frame="/map")
        self.check_refused(["~frame_prefix", "/a"], frame_prefix="/a")
        self.check_refused(["~paused", "7"], paused=7)
        self.check_refused(["no_such_scene"], scene="no_such_scene")

    def test_a_scene_that_cannot_be_ends_the_node_with_status_2(self):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as scene:
            scene.write("bodies:\n- name: a\n  mass: 0\n  shape: {point: {}}\n")
            scene.flush()
            self.check_refused([scene.name + ":3", "mass", "0"], scene=scene.name)

    def test_time_step_and_rate_are_taken_from_the_parameters(self):
        with running(node_command(time_step=0.002, paused="true", world_frame="map")):
            self.assertEqual(properties().time_step, 0.002)
            self.assertTrue(call("load_scene", text="world: {time_step: 0.004}").success)
            self.assertEqual(properties().time_step, 0.004)  # the scene's own setting takes precedence


if __name__ == "__main__":
    rospy.init_node("test_runs")
    rostest.rosrun("constraint_sim", "runs", Runs)
