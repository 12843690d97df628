#!/usr/bin/env python3
"""Every shipped launch file starts and brings up what it should; a recorded bag replays."""
import contextlib
import glob
import os
import tempfile
import unittest

import rosbag
import roslaunch.config
import rosnode
import rospkg
import rospy
import rostest
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

import support
from support import Listener, call, topics_between, wait_until

LAUNCH = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "launch")
TOPICS = ("markers", "body_states", "constraint_states", "contact_states", "statistics", "plan")


def topics_of(*simulators):
    return {"/tf"} | {"/%s/%s" % (name, topic) for name in simulators for topic in TOPICS}


def published_topics():
    return {topic for topic, _ in rospy.get_published_topics()}


def topics_of_node(name):
    """Returns the topics that a node subscribes to."""
    _, subscribers, _ = rospy.get_master().getSystemState()[2]
    return {topic for topic, nodes in subscribers if name in nodes}


def nodes_in(path, arguments):
    """Returns the full names of the nodes in a launch file."""
    config = roslaunch.config.load_config_default([(path, arguments)], None)
    return {rospy.names.ns_join(node.namespace, node.name) for node in config.nodes}


@contextlib.contextmanager
def launched(file, **arguments):
    """Runs a launch file of the package without rviz, and waits until all its nodes are up."""
    path = os.path.join(LAUNCH, file)
    if file != "record.launch":
        arguments["rviz"] = "false"
    words = ["%s:=%s" % item for item in arguments.items()]
    try:
        with support.running(["roslaunch", path] + words) as process:
            names = nodes_in(path, words)
            wait_until(lambda: names <= set(rosnode.get_node_names()), "the nodes of " + file)
            yield
            # a replay ends with its bag
            assert file == "replay.launch" or process.poll() is None, file + " ended by itself"
    finally:
        for name in ("/use_sim_time", "/constraint_sim", "/left", "/right"):
            if rospy.has_param(name):
                rospy.delete_param(name)


@contextlib.contextmanager
def in_group(file, **arguments):
    """Runs a launch file inside <group ns="robot">."""
    arguments["rviz"] = "false"
    text = '<launch><group ns="robot"><include file="%s">' % os.path.join(LAUNCH, file)
    text += "".join('<arg name="%s" value="%s"/>' % item for item in arguments.items())
    with tempfile.NamedTemporaryFile("w", suffix=".launch") as launch:
        launch.write(text + "</include></group></launch>")
        launch.flush()
        try:
            with support.running(["roslaunch", launch.name]):
                names = nodes_in(launch.name, [])
                wait_until(lambda: names <= set(rosnode.get_node_names()), "nodes in a group")
                yield
        finally:
            for name in ("/use_sim_time", "/robot"):
                if rospy.has_param(name):
                    rospy.delete_param(name)


@contextlib.contextmanager
def recorded(**arguments):
    """Returns the path of a bag with six seconds of the double pendulum, enough for a subscriber of its
    replay on a busy machine to get a part."""
    with tempfile.TemporaryDirectory() as folder:
        with launched("simulator.launch", scene="double_pendulum", record="true",
                      bag=folder + "/run", **arguments):
            wait_until(lambda: topics_between("/constraint_sim", "/record") >=
                       topics_of("constraint_sim"), "the recorder")
            start = support.properties().sim_time
            wait_until(lambda: support.properties().sim_time > start + 6.0, "6 s")
        yield wait_until(lambda: glob.glob(folder + "/run_*.bag"), "the closed bag")[0]


class Launch(unittest.TestCase):
    def test_no_launch_file_is_without_a_test(self):
        self.assertEqual(sorted(os.listdir(LAUNCH)), ["nodelet_manager.launch", "record.launch",
                                                      "replay.launch", "simulator.launch"])

    def wait_for_topics(self, expected):
        wait_until(lambda: published_topics() >= expected, "topics")

    def test_simulator_runs_a_node(self):
        with launched("simulator.launch", scene="winch", prefix="sim/", paused="true"):
            self.wait_for_topics(topics_of("constraint_sim"))
            state = support.properties()
            self.assertEqual((state.bodies, state.paused), (["floor", "load"], True))
            for topic, frame in (("/tf", "sim/load"), ("/tf_static", "sim/floor")):
                message = Listener(topic, TFMessage).find()
                self.assertEqual([t.child_frame_id for t in message.transforms], [frame])

    def test_simulator_runs_a_nodelet_under_another_name(self):
        with launched("simulator.launch", nodelet="true", name="left"):
            self.wait_for_topics(topics_of("left"))
            self.assertEqual(call("/left/get_world_properties").bodies, ["bob"])

    def test_simulator_takes_a_file_of_parameters(self):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            file.write("world_frame: map\n")
            file.flush()
            with launched("simulator.launch", parameters=file.name):
                message = Listener("/tf", TFMessage).wait()
                self.assertEqual(message.transforms[0].header.frame_id, "map")

    def test_two_simulators_share_a_nodelet_manager(self):
        transforms = Listener("/tf", TFMessage)
        with launched("nodelet_manager.launch"):
            self.wait_for_topics(topics_of("left", "right"))
            self.assertEqual(call("/left/get_world_properties").bodies, ["bob"])
            self.assertEqual(call("/right/get_world_properties").bodies, ["upper", "lower"])
            for body, simulator in (("mine", "/left"), ("yours", "/right")):
                answer = call(simulator + "/add_body", body=support.sphere(body))
                self.assertTrue(answer.success, answer.status_message)
            wait_until(lambda: {t.child_frame_id for m in transforms.messages for t in m.transforms}
                       == {"left/bob", "left/mine", "right/upper", "right/lower", "right/yours"},
                       "the frames of both")

    # ---- bags

    def check_replay(self, bag):
        transforms = Listener("/tf", TFMessage)
        markers = Listener("/constraint_sim/markers", MarkerArray)
        clock = Listener("/clock", Clock)
        with launched("replay.launch", bag=bag):
            # a node whose end was forced, as on a busy machine, stays among the master's names
            self.assertFalse("/constraint_sim" in rosnode.get_node_names() and
                             rosnode.rosnode_ping("/constraint_sim", max_count=1))

            def places():
                found = [t.transform.translation for m in transforms.messages for t in m.transforms
                         if t.child_frame_id == "lower"]
                return [p.z for p in found] or [0.0]
            # the lower ball first falls freely; in a second it moves much farther than this
            wait_until(lambda: max(places()) - min(places()) > 0.1, "a transform that moves")
            drawn = wait_until(lambda: {(m.ns, m.action) for a in markers.messages
                                        for m in a.markers}, "markers")
            self.assertLessEqual({("bodies", Marker.ADD), ("constraints", Marker.ADD)}, drawn)

            # stamps and the clock of the replay are those of the recording, in any clock
            now = clock.find().clock
            stamp = transforms.find().transforms[0].header.stamp
            with rosbag.Bag(bag) as recorded_bag:
                begin, end = recorded_bag.get_start_time(), recorded_bag.get_end_time()
                stamps = [m.transforms[0].header.stamp
                          for _, m, _ in recorded_bag.read_messages(topics="/tf")]
            self.assertIn(stamp, stamps)
            self.assertTrue(begin <= now.to_sec() <= end, (begin, now, end))
            within = [s for s in stamps if begin <= s.to_sec() <= end]
            self.assertGreater(len(within), len(stamps) // 2)

    def test_a_recorded_bag_replays_without_the_node(self):
        with recorded() as bag:
            self.check_replay(bag)
            # nodes that start after a replay do not wait for its clock
            path = os.path.join(LAUNCH, "replay.launch")
            with support.running(["roslaunch", path, "bag:=" + bag, "rviz:=false"]):
                wait_until(lambda: rospy.has_param("/use_sim_time") and
                           "/play" in rosnode.get_node_names(), "the replay")
            self.assertFalse(rospy.get_param("/use_sim_time", False))

    def test_a_bag_of_simulated_time_replays_without_the_node(self):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            file.write("publish_clock: true\n")
            file.flush()
            rospy.set_param("/use_sim_time", True)
            with recorded(parameters=file.name) as bag:
                self.check_replay(bag)

    def test_all_of_it_works_in_a_group(self):
        """The node, its recorder, the replay of its bag, and two nodelets, in /robot."""
        full = {t.replace("/left", "/robot/left") for t in topics_of("left")}
        with tempfile.TemporaryDirectory() as folder:
            with in_group("simulator.launch", name="left", prefix="left/", scene="double_pendulum",
                          record="true", bag=folder + "/run"):
                wait_until(lambda: topics_between("/robot/left", "/robot/record") >= full,
                           "the recorder")
                state = call("/robot/left/get_world_properties")
                self.assertEqual(state.bodies, ["upper", "lower"])
                tick = state.time_step
                wait_until(lambda: call("/robot/left/get_world_properties").step >
                           state.step + 6.0 / tick, "6 s")
            bag = wait_until(lambda: glob.glob(folder + "/run_*.bag"), "the closed bag")[0]
            with rosbag.Bag(bag) as recorded_bag:
                self.assertLessEqual(full, set(recorded_bag.get_type_and_topic_info().topics))
            markers = Listener("/robot/left/markers", MarkerArray)
            with in_group("replay.launch", name="left", bag=bag):
                wait_until(lambda: markers.messages, "replayed markers")
            with in_group("nodelet_manager.launch"):
                for simulator in ("/robot/left", "/robot/right"):
                    self.assertTrue(call(simulator + "/get_world_properties").success)

    def test_record_records_a_running_simulator(self):
        with tempfile.TemporaryDirectory() as folder:
            with launched("record.launch", bag=folder + "/run", name="left"):
                wait_until(lambda: topics_of_node("/record") >= topics_of("left") | {"/clock"},
                           "the recorder")
            wait_until(lambda: glob.glob(folder + "/run_*.bag"), "the closed bag")


if __name__ == "__main__":
    rospy.init_node("test_launch")
    rostest.rosrun("constraint_sim", "launch", Launch)
