#!/usr/bin/env python3
"""Five robots of users (test/urdf/robots), by every way that loads one: a path, a parameter, the launch file,
spawn and the service. Each follows a trajectory; meshes are shown by their files."""
import os
import shutil
import subprocess
import tempfile
import unittest

import rospy
import rostest
from constraint_sim_client import Simulator
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

import support
from support import NODE, Listener, call, node_command, properties, running, wait_until
from test_launch import launched

ROBOTS = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "urdf", "robots")
# bodies and constraints of each
SIZES = {"arm6": (9, 9), "delta": (5, 9), "fivebar": (5, 5), "gantry": (4, 3), "quad12": (13, 12)}


def text_of(robot):
    with open(os.path.join(ROBOTS, robot + ".urdf")) as file:
        return file.read()


def motors(*joints):
    return "motors: {%s}" % ", ".join("%s: {position: 0}" % joint for joint in joints)


class FiveRobots(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = os.path.join(folder.name, "my robots-1")
        shutil.copytree(ROBOTS, self.folder)
        self.addCleanup(Listener.stop_all)

    def path(self, robot):
        return os.path.join(self.folder, robot + ".urdf")

    def check(self, robot):
        found = properties()
        self.assertEqual((len(found.bodies), len(found.constraints)), SIZES[robot], robot)

    def test_by_every_way(self):
        for robot in SIZES:
            with running(node_command(paused=True, robot=self.path(robot))):
                self.check(robot)
            with running(node_command(paused=True, robot=robot + ".urdf"), cwd=self.folder):
                self.check(robot)
            rospy.set_param("/robot_description", text_of(robot))
            beside = os.path.join(self.folder, robot + ".yaml")
            extra = {"robot_extra": beside} if os.path.exists(beside) else {}
            with running(node_command(paused=True, robot="/robot_description", **extra)):
                # a text has no folder, and meshes that are not found do not collide
                self.check(robot)
            with launched("simulator.launch", robot=self.path(robot), paused="true"):
                self.check(robot)
        rospy.delete_param("/robot_description")

    def test_by_spawn_python_and_the_service(self):
        for robot in SIZES:
            with running(node_command(paused=True)):
                done = subprocess.run(["rosrun", "constraint_sim", "spawn", "-urdf", self.path(robot)],
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                      universal_newlines=True, timeout=support.TIMEOUT)
                self.assertEqual(done.returncode, 0, done.stdout)
                self.check(robot)
                answer = Simulator().load_urdf(self.path(robot), prefix="b/", position=(9, 0, 0))
                self.assertTrue(answer.success, answer.status_message)
                answer = call("load_urdf", path=self.path(robot), prefix="c/")
                self.assertTrue(answer.success, answer.status_message)
                self.assertEqual((len(answer.bodies), len(answer.constraints)), SIZES[robot])

    def test_meshes_are_markers_by_their_files(self):
        with running(node_command(paused=True, robot=self.path("gantry"))):
            markers = Listener(NODE + "/markers", MarkerArray)
            message = markers.wait(lambda m: any(x.ns == "visuals" for x in m.markers))
            visuals = {os.path.basename(m.mesh_resource): m for m in message.markers
                       if m.ns == "visuals"}
            self.assertEqual(sorted(visuals), ["bridge.stl", "carriage.dae", "hook.stl"])
            for name, marker in visuals.items():
                self.assertEqual(marker.type, Marker.MESH_RESOURCE)
                path = os.path.join(self.folder, name).replace(" ", "%20")
                self.assertEqual(marker.mesh_resource, "file://" + path)
            self.assertEqual(visuals["hook.stl"].scale.x, 0.001)
            self.assertTrue(visuals["carriage.dae"].mesh_use_embedded_materials)
            # a RobotModel of rviz reads this parameter
            described = rospy.get_param(NODE + "/robots/gantry/robot_description")
            self.assertIn('filename="file://%s' % self.folder.replace(" ", "%20"), described)
        with running(node_command(paused=True)):
            # no folder: no picture, and the answer says so
            answer = call("load_urdf", text=text_of("gantry"))
            self.assertTrue(answer.success, answer.status_message)
            for name in ("bridge.stl", "carriage.dae", "hook.stl"):
                self.assertIn("the mesh '%s' is not shown" % name, answer.status_message)
            os.remove(os.path.join(self.folder, "hook.stl"))
            answer = call("load_urdf", path=self.path("gantry"), prefix="b/")
            self.assertFalse(answer.success)
            self.assertIn("link 'hook': there is no mesh 'file://", answer.status_message)

    def test_pairs_of_an_srdf_do_not_collide(self):
        srdf = '<robot name="arm6"><disable_collisions link1="upper" link2="wrist_1"/></robot>'
        with open(os.path.join(self.folder, "arm6.srdf"), "w") as file:
            file.write(srdf)
        pair = "no_contact/upper/wrist_1"
        with running(node_command(paused=True, robot=self.path("arm6"))):
            self.assertIn(pair, properties().constraints)
            states = Listener(NODE + "/joint_states", JointState).find()
            self.assertIn("joint_6", states.name)
            self.assertNotIn(pair, states.name)
            # nor are they drawn or labelled
            names = properties().constraints
            markers, labels = (Listener(NODE + topic, MarkerArray) for topic in ("/markers", "/labels"))
            drawn = markers.find(lambda m: any(x.ns == "joints" for x in m.markers))
            ids = {m.id for m in drawn.markers if m.ns in ("constraints", "joints")}
            self.assertEqual(len(ids), len([n for n in names if not n.startswith("no_contact/")]))
            told = labels.find(lambda m: any(x.ns == "constraint_names" for x in m.markers))
            texts = {m.text for m in told.markers if m.ns == "constraint_names"}
            self.assertIn("joint_6", texts)
            self.assertFalse([text for text in texts if "no_contact" in text])
        for name, value in (("/robot_description", text_of("arm6")),
                            ("/robot_description_semantic", srdf)):
            rospy.set_param(name, value)
            self.addCleanup(rospy.delete_param, name)
        with running(node_command(paused=True, robot="/robot_description")):
            self.assertIn(pair, properties().constraints)

    def test_a_trajectory_is_followed_at_each_time_step(self):
        """Motors have the efforts of the URDF. The first point is as MoveIt sends it, and off."""
        joints = ["joint_%d" % i for i in range(1, 7)] + ["finger_joint"]
        ends = [0.5, -0.4, 0.6, 0.3, -0.2, 0.4, 0.02]
        for rate in (30, 60, 240, 1000):
            with running(node_command(paused=True, real_time_factor=0, time_step=1.0 / rate)):
                answer = call("load_urdf", path=self.path("arm6"), fixed=True, extra=motors(*joints))
                self.assertTrue(answer.success, answer.status_message)
                states = Listener(NODE + "/joint_states", JointState)
                topic = rospy.Publisher(NODE + "/joint_trajectory", JointTrajectory, queue_size=1)
                wait_until(topic.get_num_connections, "the simulator")
                zeros = [0.0] * len(joints)
                points = [JointTrajectoryPoint(positions=[0.002] * len(joints), velocities=zeros,
                                               accelerations=zeros),
                          JointTrajectoryPoint(positions=ends, velocities=zeros, accelerations=zeros,
                                               time_from_start=rospy.Duration(1.0))]
                before = properties().state_hash
                topic.publish(JointTrajectory(joint_names=joints, points=points))
                start = {body.name: body for body in call("step", steps=0).bodies}

                def begins():
                    now = {body.name: body for body in call("step", steps=1).bodies}
                    return now["upper/com"].pose != start["upper/com"].pose
                wait_until(begins, "the start of the trajectory")
                self.assertNotEqual(properties().state_hash, before)
                # a quintic is half way in the middle; one tick is done
                for steps, share in ((rate // 2 - 1, 0.5), (rate - rate // 2, 1.0), (rate, 1.0)):
                    call("step", steps=steps)
                    self.expect(states, dict(zip(joints, [share * end for end in ends])))

    def expect(self, listener, positions):
        def differences():
            if not listener.messages:
                return {}
            found = dict(zip(listener.messages[-1].name, listener.messages[-1].position))
            return {joint: abs(found[joint] - value) for joint, value in positions.items()}
        try:
            wait_until(lambda: differences() and max(differences().values()) < 1e-6, "positions", 20.0)
        except AssertionError:
            self.fail("off by %s" % differences())


if __name__ == "__main__":
    rospy.init_node("test_five_robots")
    rostest.rosrun("constraint_sim", "five_robots", FiveRobots)
