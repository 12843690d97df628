#!/usr/bin/env python3
"""`spawn` adds robots from command lines and launch files, with the arguments of gazebo_ros's spawn_model."""
import math
import os
import subprocess
import tempfile
import time
import unittest

import numpy
import rospkg
import rospy
import rostest
from constraint_sim.msg import ConstraintStates
from constraint_sim_client import Refused, Simulator

import support
from support import NODE, call, node_command, properties, running, wait_until

PACKAGE = rospkg.RosPack().get_path("constraint_sim")
SHIPPED = os.path.join(PACKAGE, "config", "robots", "arm.urdf")
MASS = ('<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        '</inertial>')
# The frames of the bodies are those of the links, since the centres of mass are at their origins.
DOOR = ('<robot name="door"><link name="frame">%s</link><link name="leaf">%s</link>'
        '<joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/>'
        '<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        '</robot>' % (MASS, MASS))
# A bar of 1 m on two cranks of 0.5 m; the last joint closes the loop.
FOUR_BAR = ('<sdf version="1.7"><model name="four_bar">%s%s%s%s%s%s%s</model></sdf>' % (
    *('<link name="%s"><pose>%r 0 %r 0 0 0</pose><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy>'
      '<izz>1</izz></inertia></inertial><visual name="v"><geometry><sphere><radius>0.1</radius></sphere>'
      '</geometry></visual></link>' % link for link in (("crank", 0, 2), ("rocker", 1, 2), ("coupler", 0, 1.5))),
    *('<joint name="%s" type="revolute"><parent>%s</parent><child>%s</child><pose>%r 0 0 0 0 0</pose>'
      '<axis><xyz>0 1 0</xyz></axis></joint>' % joint for joint in (
          ("a", "world", "crank", 0), ("b", "crank", "coupler", 0), ("c", "world", "rocker", 0),
          ("d", "rocker", "coupler", 1)))))


def spawn(*words, **options):
    return subprocess.run(["rosrun", "constraint_sim", "spawn", *words], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, universal_newlines=True,
                          timeout=support.TIMEOUT, **options)


def rotation_of(q):
    x, y, z, w = q.x, q.y, q.z, q.w
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def turn(axis, angle):
    """Returns the rotation matrix about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = numpy.eye(3)
    R[i, i] = R[j, j] = math.cos(angle)
    R[i, j], R[j, i] = -math.sin(angle), math.sin(angle)
    return R


class Spawn(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        os.mkdir(os.path.join(self.folder, "my robot-1.2"))
        self.path = os.path.join(self.folder, "my robot-1.2", "door-v1.urdf")
        with open(self.path, "w") as file:
            file.write(DOOR)
        rospy.set_param("/door", DOOR)
        self.addCleanup(rospy.delete_param, "/door")

    def added(self, *words, **options):
        """Returns the names of bodies that a successful call adds."""
        before = properties().bodies
        done = spawn(*words, **options)
        self.assertEqual(done.returncode, 0, done.stdout)
        return [name for name in properties().bodies if name not in before]

    def rejected(self, status, parts, *words):
        before = properties().state_hash
        done = spawn(*words)
        self.assertEqual(done.returncode, status, done.stdout)
        self.assertNotIn("Traceback", done.stdout)
        for part in parts:
            self.assertIn(part, done.stdout)
        self.assertEqual(properties().state_hash, before)

    def test_each_source(self):
        with running(node_command(paused=True)):
            sim = Simulator()
            door = ["frame/com", "leaf/com"]
            self.assertEqual(self.added("-urdf", self.path), door)
            for i, (words, options) in enumerate((
                    (["-urdf", "my robot-1.2/door-v1.urdf"], {"cwd": self.folder}),
                    (["-file", self.path, "-urdf"], {}),
                    (["-param", "/door"], {}), (["-param", "door", "-urdf"], {}),
                    (["-stdin"], {"input": DOOR}))):
                prefix = "door%d/" % i
                self.assertEqual(self.added(*words, "-robot_name", prefix[:-1], **options),
                                 [prefix + name for name in door], words)
            arm = self.added("-urdf", "arm", "-prefix", "a_")
            self.assertEqual(len(arm), 7)
            self.assertEqual([name.replace("b_", "a_") for name in self.added(
                "-urdf", "package://constraint_sim/config/robots/arm.urdf", "-prefix", "b_")], arm)
            # Python takes equal names
            for i, name in enumerate((self.path, "/door", "door", "arm",
                                      "package://constraint_sim/config/robots/arm.urdf")):
                prefix = "python%d/" % i
                bodies = sim.load_urdf(name, prefix=prefix, position=(0, 0, i)).bodies
                expected = door if "door" in name else [body[2:] for body in arm]
                self.assertEqual(bodies, [prefix + body for body in expected])
                if expected is door:  # the arm's centres of mass are above its links
                    self.assertEqual(sim.state(bodies[0]).pose.position.z, i)
            self.assertEqual(sim.load_urdf(text=DOOR, prefix="t/").bodies, ["t/" + d for d in door])
            for name in ("a.b", "nothing", self.path + "x", "~a.b", "/nothing"):
                with self.assertRaisesRegex(Refused, "load_urdf"):
                    sim.load_urdf(name)

    def test_pose_and_names(self):
        with running(node_command(paused=True)):
            done = self.added("-param", "door", "-x", "1.5", "-y", "-2", "-z", "3e-1", "-R", "0.3",
                              "-P", "-0.4", "-Y", "2", "-robot_name", "left", "-J", "hinge", "0.7")
            self.assertEqual(done, ["left/frame/com", "left/leaf/com"])
            self.assertEqual(properties().constraints, ["left/hinge"])
            frame = call("get_body_state", name="left/frame/com").state.pose
            self.assertEqual((frame.position.x, frame.position.y, frame.position.z), (1.5, -2.0, 0.3))
            R = turn(2, 2.0) @ turn(1, -0.4) @ turn(0, 0.3)  # rotations about fixed axes, as in URDF
            leaf = call("get_body_state", name="left/leaf/com").state.pose
            for pose, expected in ((frame, R), (leaf, R @ turn(2, 0.7))):
                error = numpy.abs(rotation_of(pose.orientation) - expected).max()
                self.assertLess(error, 1e-14)  # some products of rounded numbers
            self.assertEqual(self.added("-param", "door", "-model", "m", "-prefix", "right_", "-fixed"),
                             ["right_frame/com", "right_leaf/com"])
            # -J keeps the YAML beside the URDF, which closes the gripper's loops
            added = call("load_urdf", path="gripper", prefix="g/", fixed=True)
            self.assertTrue(added.success, added.status_message)
            closed = {name[2:] for name in properties().constraints if name.startswith("g/")}
            self.added("-urdf", "gripper", "-fixed", "-prefix", "h/", "-J", "lift", "0.1")
            self.assertEqual({name[2:] for name in properties().constraints if name.startswith("h/")},
                             closed)
            state = call("get_body_state", name="right_frame/com").state.pose.position
            call("step", steps=10)
            self.assertEqual(call("get_body_state", name="right_frame/com").state.pose.position, state)
            self.added("-param", "door", "-prefix", "last/", "-unpause")
            self.assertFalse(properties().paused)

    def test_rejections_say_why_and_add_nothing(self):
        with running(node_command(paused=True)):
            self.added("-param", "door")
            for parts, words in (
                    (["already a body named 'frame/com'"], ["-param", "door"]),
                    (["'door2'", "arm gripper quadruped"], ["-urdf", "door2"]),
                    (["/tmp/no-door.urdf"], ["-urdf", "/tmp/no-door.urdf"]),
                    (["/tmp/no-door.sdf"], ["-sdf", "-file", "/tmp/no-door.sdf"]),
                    (["no package 'nowhere'"], ["-urdf", "package://nowhere/door.urdf"]),
                    (["no package 'nowhere'"], ["-urdf", "package://nowhere/d.urdf", "-J", "a", "1"]),
                    (["no text in the parameter /nothing"], ["-param", "nothing"]),
                    (["no joint 'wheel'"], ["-param", "door", "-prefix", "b/", "-J", "wheel", "1"]),
                    (["no-extra.yaml"], ["-param", "door", "-prefix", "b/", "-extra", "no-extra.yaml"]),
                    (["is no map"], ["-param", "door", "-prefix", "b/", "-extra", SHIPPED, "-J", "a", "1"])):
                self.rejected(1, ["spawn: "] + parts, *words)
            for part, words in (("exactly one of", []), ("exactly one of", ["-urdf"]),
                                ("exactly one of", ["-urdf", "arm", "-param", "door"]),
                                ("-x", ["-urdf", "arm", "-x", "nan"]),
                                ("-J", ["-urdf", "arm", "-J", "elbow", "much"]),
                                ("-reference_frame", ["-urdf", "arm", "-reference_frame", "world"])):
                self.rejected(2, [part], *words)
            self.rejected(1, ["/nobody/load_urdf"], "-urdf", "arm", "-node", "nobody", "-timeout", "0.5")

    def test_an_sdf_with_a_loop(self):
        path = os.path.join(self.folder, "four_bar.sdf")
        with open(path, "w") as file:
            file.write(FOUR_BAR)
        rospy.set_param("/sdf", FOUR_BAR)
        self.addCleanup(rospy.delete_param, "/sdf")
        with running(node_command(paused=True)):
            answer = call("load_urdf", text=FOUR_BAR)
            if "built without libsdformat" in answer.status_message:
                self.skipTest(answer.status_message)
        bodies, joints = ["world/com", "crank/com", "coupler/com", "rocker/com"], list("abcd")
        for robot in (path, "/sdf"):
            with running(node_command(paused=True, robot=robot)):
                self.assertEqual(sorted(properties().bodies), sorted(bodies))
                self.assertEqual(properties().constraints, joints)
                description = rospy.get_param(NODE + "/robots/four_bar/robot_description")
                self.assertIn('<robot name="four_bar">', description)
                self.assertIn('<joint name="a" type="continuous">', description)
                self.assertNotIn('<joint name="d"', description)
                for i, words in enumerate((["-sdf", path], ["-file", path, "-sdf"], ["-param", "sdf"])):
                    prefix = "r%d/" % i
                    self.assertEqual(sorted(self.added(*words, "-prefix", prefix, "-x", "3")),
                                     sorted(prefix + body for body in bodies))
                call("step", steps=100)
                states = support.Listener(NODE + "/constraint_states", ConstraintStates).present().constraints
                self.assertEqual(len(states), 16)
                for state in states:
                    self.assertLess(abs(state.error), 1e-9, state.name)  # rounding of the projection

    def test_it_waits_for_the_simulator(self):
        with running(["rosrun", "constraint_sim", "spawn", "-param", "door"]) as process:
            wait_until(lambda: any("spawn" in name for name in support.rosnode.get_node_names()),
                       "the program")
            time.sleep(0.5)
            self.assertIsNone(process.poll())
            with running(node_command(paused=True)):
                self.assertEqual(process.wait(timeout=support.TIMEOUT), 0)
                self.assertEqual(properties().bodies, ["frame/com", "leaf/com"])

    def test_several_robots_in_a_launch_file_in_a_group(self):
        text = """<launch><group ns="lab">
          <param name="robot_description" textfile="%s"/>
          <include file="%s/launch/simulator.launch">
            <arg name="scene" value="none"/><arg name="rviz" value="false"/><arg name="paused" value="true"/>
          </include>
          <node pkg="constraint_sim" type="spawn" name="spawn_left" output="screen"
                args="-urdf -param robot_description -model left -x 1"/>
          <node pkg="constraint_sim" type="spawn" name="spawn_right" output="screen"
                args="-urdf '%s' -robot_name right -y 2 -Y 1.57"/>
        </group></launch>""" % (SHIPPED, PACKAGE, self.path)
        launch = os.path.join(self.folder, "lab.launch")
        with open(launch, "w") as file:
            file.write(text)
        self.addCleanup(rospy.delete_param, "/lab")
        with running(["roslaunch", launch]):
            def bodies():
                return call("/lab/constraint_sim/get_world_properties").bodies
            wait_until(lambda: len(bodies()) == 9, "both robots")
            self.assertEqual({name.split("/")[0] for name in bodies()}, {"left", "right"})


if __name__ == "__main__":
    rospy.init_node("test_spawn")
    rostest.rosrun("constraint_sim", "spawn", Spawn)
