#!/usr/bin/env python3
"""The Python client, and the examples of clients in Python and C++."""
import os
import subprocess
import sys
import tempfile
import unittest

import rospkg
import rospy
import rostest
from constraint_sim_client import Refused, Simulator
from geometry_msgs.msg import Quaternion

import support

EXAMPLES = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "examples")


def output_of(*command):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, timeout=60)
    assert done.returncode == 0, done.stdout
    return done.stdout


class Client(unittest.TestCase):
    def setUp(self):
        support.empty_world()
        self.sim = Simulator()

    def test_bodies_of_all_shapes(self):
        sim = self.sim
        sim.add_sphere("ball", radius=0.1, mass=1.0, position=(1, 2, 3), linear_velocity=(0, 0, 1),
                       orientation=(0, 0, 1, 0), restitution=0.5)
        sim.add_box("box", size=(0.1, 0.2, 0.3), mass=2.0, inertia=(1, 2, 2.5), color=(1, 0.5, 0, 1))
        sim.add_point("point", mass=1.0)
        sim.add_plane("floor", position=(0, 0, -5), friction=0.5)
        self.assertEqual(sim.properties().bodies, ["ball", "box", "point", "floor"])
        state = sim.state("ball")
        self.assertEqual((state.pose.position.z, state.twist.linear.z), (3.0, 1.0))
        self.assertEqual(state.pose.orientation, Quaternion(0, 0, 1, 0))
        self.assertIn("inertia: [1, 2, 2.5]", sim.save())
        self.assertIn("color: [1, 0.5, 0, 1]", sim.save())
        sim.set_state("ball", position=(7, 0, 0))
        self.assertEqual(sim.state("ball").pose.position.x, 7.0)
        sim.remove_body("ball")
        self.assertEqual(sim.properties().bodies, ["box", "point", "floor"])
        with self.assertRaisesRegex(Refused, "mass"):
            sim.add_sphere("bad", radius=0.1, mass=-1.0)
        with self.assertRaises(ValueError):
            sim.add_sphere("bad", radius=0.1, type="heavy")
        with self.assertRaises(TypeError):
            sim.add_sphere("bad", radius=0.1, colour="red")

    def test_constraints_motors_and_pushes(self):
        sim = self.sim
        sim.set_options(gravity=(0, 0, 0), tolerance=1e-10, sleep_after=float("inf"))
        sim.add_box("door", size=(0.8, 0.05, 1.5), mass=5.0, position=(0.4, 0, 1))
        answer = sim.add_constraint("hinge", "hinge", anchor_a=(0, 0, 1), body_b="door",
                                    anchor_b=(-0.4, 0, 0), axis_a=(0, 0, 1), lower=-1.5, upper=1.5)
        self.assertEqual(answer.initial_error, 0.0)
        sim.set_motor("hinge", bias=0.5, max_force=20.0, timeout=1.0)
        sim.step(100)
        state = sim.state("door")
        # a motor without a load turns by 0.5 rad in 1 s, except for its start
        self.assertAlmostEqual(2.0 * state.pose.orientation.z, 0.5, delta=0.02)
        sim.set_constraint("hinge", enabled=0)
        sim.push("door", force=(0, 0, 5.0), duration=1.0)
        before = sim.state("door").twist.linear.z
        sim.step(100)
        self.assertAlmostEqual(sim.state("door").twist.linear.z - before, 1.0, delta=1e-9)
        sim.set_body("door", mass=10.0, friction=0.3)
        self.assertIn("mass: 10", sim.save())
        with self.assertRaisesRegex(TypeError, "no_such_key"):
            sim.add_constraint("other", "hinge", body_b="door", no_such_key=1.0)
        with self.assertRaisesRegex(TypeError, "no_such_key"):
            sim.add_constraint("other", "hinge", body_b="door", motor=dict(no_such_key=1.0))
        sim.add_box("drill", size=(0.1, 0.1, 0.4), mass=1.0, position=(3, 0, 0))
        sim.add_constraint("chuck", "cylindrical", anchor_a=(3, 0, 0), body_b="drill", break_torque=50.0, coordinates=[
            dict(upper=0.5, friction=0.25), dict(motor=dict(position=1.5, servo_frequency=2.0))])
        text = sim.save()
        for line in ("break_torque: 50", "upper: 0.5", "friction: 0.25", "position: 1.5", "servo_damping: "):
            self.assertIn(line, text)
        self.assertNotIn("lower", text.partition("chuck")[2])

    def test_a_batch_is_all_or_nothing(self):
        with self.sim.batch() as batch:
            batch.add_sphere("a", radius=0.1, mass=1.0)
            batch.add_sphere("b", radius=0.1, mass=1.0, position=(1, 0, 0))
            batch.add_constraint("rod", "distance", body_a="a", body_b="b")
            batch.set_motor("rod", bias=0.1)
            batch.set_state("b", position=(1, 0, 0), linear_velocity=(0, 1, 0))
        self.assertEqual(list(batch.answer.initial_errors), [0.0])
        before = self.sim.properties()
        self.assertEqual(before.constraints, ["rod"])
        with self.assertRaisesRegex(Refused, r"bodies\[1\]"):
            with self.sim.batch() as batch:
                batch.add_sphere("c", radius=0.1, mass=1.0)
                batch.add_sphere("d", radius=0.1, mass=0.0)
        with self.assertRaises(ZeroDivisionError):
            with self.sim.batch() as batch:
                batch.add_sphere("c", radius=0.1, mass=1.0)
                batch.remove_constraint(1 / 0)
        self.assertEqual(self.sim.properties().state_hash, before.state_hash)

    def test_blocks(self):
        sim = self.sim
        sim.load("pendulum")
        sim.unpause()
        with sim.paused():
            self.assertTrue(sim.properties().paused)
            before = sim.properties().state_hash
            with self.assertRaises(Refused):
                with sim.tried():
                    sim.step(10)
                    sim.remove_body("nobody")
            self.assertEqual(sim.properties().state_hash, before)
        self.assertFalse(sim.properties().paused)
        sim.pause()
        with sim.paused():
            pass
        self.assertTrue(sim.properties().paused)

    def test_joints_follow_and_are_read(self):
        sim = self.sim
        with sim.paused():
            sim.load_urdf("arm", fixed=True)
            joints = sim.joints()
            self.assertAlmostEqual(joints["shoulder_lift"].position, -1.2, delta=1e-9)
            self.assertEqual(set(joints), set(sim.joints("arm")))
            # motors to a position arrive within the closing time of 0.5 s
            sim.step(100, positions={"elbow": 1.4, "shoulder_pan": 0.1})
            self.assertAlmostEqual(sim.state("forearm/com").twist.angular.z, 0.0, delta=1e-9)
            support.wait_until(lambda: abs(sim.joints()["elbow"].position - 1.4) < 1e-9, "the elbow")
            self.assertAlmostEqual(sim.joints("arm")["shoulder_pan"].position, 0.1, delta=1e-9)
            self.assertGreater(abs(sim.joints()["shoulder_lift"].effort), 1.0)  # holds the arm
            hash_before = sim.properties().state_hash
            sim.follow(["elbow"], (1.0, [1.2], [0.0]))

            def arrives():
                sim.step(10)
                return abs(sim.joints()["elbow"].position - 1.2) < 1e-9
            support.wait_until(arrives, "the end of the trajectory")
            self.assertNotEqual(sim.properties().state_hash, hash_before)
            with self.assertRaisesRegex(Refused, "no constraint named 'knee'"):
                sim.step(1, rates={"elbow": 0.1, "knee": 0.1})

    def test_motors_are_set_with_the_steps(self):
        sim = self.sim
        sim.set_options(gravity=(0, 0, 0))
        with sim.paused():
            for name, y in (("a", 0.0), ("b", 2.0)):
                sim.add_box(name, size=(0.1, 0.1, 0.1), mass=1.0, position=(0, y, 0))
                sim.add_constraint("rail_" + name, "slider", anchor_a=(0, y, 0), axis_a=(1, 0, 0), body_b=name,
                                   motor={"bias": 0.0})
            sim.step(100, rates={"rail_a": 0.2})
            self.assertAlmostEqual(sim.state("a").pose.position.x, 0.2, delta=1e-9)
            sim.step(100, forces={"rail_b": 0.5})  # 0.5 N on 1 kg for 1 s
            self.assertAlmostEqual(sim.state("b").pose.position.x, 0.25, delta=1e-9)
            self.assertAlmostEqual(sim.state("a").pose.position.x, 0.4, delta=1e-9)
            path = os.path.join(tempfile.mkdtemp(), "two.yaml")
            sim.save(path)
            sim.load(path=path)
            self.assertEqual(sim.properties().bodies, ["a", "b"])

    def test_no_simulator_is_there(self):
        with self.assertRaises(rospy.ROSException):
            Simulator("/nobody", timeout=0.2).properties()

    def test_the_example_in_python(self):
        said = output_of(sys.executable, os.path.join(EXAMPLES, "client.py"))
        self.assertIn("with a heavy end", said)
        self.assertIn("radius", said)

    def test_the_example_in_cpp(self):
        said = output_of("rosrun", "constraint_sim", "client_example")
        # the pendulum of 1 m released from the horizontal, as in the engine's own test
        x, z = [float(word.split()[0]) for word in said.split("= ")[1:]]
        self.assertAlmostEqual(x * x + z * z, 1.0, delta=2e-6)  # rounding of the printed digits


if __name__ == "__main__":
    rospy.init_node("test_client")
    rostest.rosrun("constraint_sim", "client", Client)
