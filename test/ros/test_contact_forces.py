#!/usr/bin/env python3
"""Tests contact_forces against closed forms: a block on a slope, held by friction or sliding."""
import math
import unittest

import numpy
import rospy
import rostest
from constraint_sim.msg import ContactForce, ContactForces

from support import NODE, Listener, call

G, MASS, SLOPE, HEIGHT = 9.81, 2.0, 0.4, 0.4
UP = numpy.array([math.sin(SLOPE), 0.0, math.cos(SLOPE)])         # normal of the slope
DOWNHILL = numpy.array([math.cos(SLOPE), 0.0, -math.sin(SLOPE)])


def scene(method, friction):
    turn = "[0, %.17g, 0, %.17g]" % (math.sin(SLOPE / 2), math.cos(SLOPE / 2))
    return """
world: {gravity: [0, 0, -%g], time_step: 0.005, method: %s, sleep_after: .inf}
bodies:
  - {name: slope, type: static, shape: {plane: {}}, friction: %g, orientation: %s}
  - {name: block, mass: %g, shape: {box: {size: [0.6, 0.5, %g]}}, friction: %g, orientation: %s,
     position: [%.17g, 0, %.17g]}
""" % (G, method, friction, turn, MASS, HEIGHT, friction, turn,
       *(0.5 * HEIGHT * UP[[0, 2]]))


def vector(message):
    return numpy.array([message.x, message.y, message.z])


class Forces(unittest.TestCase):
    def setUp(self):
        call("pause_physics")

    def tearDown(self):
        Listener.stop_all()

    def contacts(self, method, friction, steps):
        """Returns forces on the block and its slip on the slope at each contact, and the messages."""
        answer = call("load_scene", text=scene(method, friction))
        self.assertTrue(answer.success, answer.status_message)
        listener = Listener(NODE + "/contact_forces", ContactForces)
        self.assertTrue(call("step", steps=steps).success)
        message = listener.present()
        self.assertEqual(len(message.contacts), 4)
        self.assertEqual(message.header.frame_id, "world")
        found = []
        for contact in message.contacts:
            self.assertEqual({contact.body_a, contact.body_b}, {"block", "slope"})
            sign = 1.0 if contact.body_a == "block" else -1.0
            numpy.testing.assert_allclose(sign * vector(contact.normal), UP, atol=1e-3)
            found.append((sign * vector(contact.force), sign * vector(contact.slip_velocity),
                          contact))
        return found

    def check_held(self, method, rounding):
        found = self.contacts(method, 0.6, 200)
        total = sum(force for force, _, _ in found)
        self.assertAlmostEqual(total.dot(UP), MASS * G * math.cos(SLOPE), delta=rounding)
        self.assertAlmostEqual(-total.dot(DOWNHILL), MASS * G * math.sin(SLOPE), delta=rounding)
        for _, slip, contact in found:
            self.assertEqual(contact.state, ContactForce.STICKING)
            self.assertLess(numpy.linalg.norm(slip), rounding)
            self.assertLessEqual(contact.gap, 0.0)

    def test_by_events_friction_holds_the_block(self):
        self.check_held("event_driven", 1e-9)

    def test_by_impulses_friction_holds_the_block(self):
        self.check_held("sequential_impulses", 0.02)  # residual of the sweeps, of 20 N

    def check_sliding(self, method, rounding):
        mu = 0.2
        found = self.contacts(method, mu, 200)
        normal = MASS * G * math.cos(SLOPE)
        total = sum(force for force, _, _ in found)
        self.assertAlmostEqual(total.dot(UP), normal, delta=rounding)
        self.assertAlmostEqual(-total.dot(DOWNHILL), mu * normal, delta=rounding)
        speed = G * (math.sin(SLOPE) - mu * math.cos(SLOPE)) * 200 * 0.005
        for force, slip, contact in found:
            self.assertEqual(contact.state, ContactForce.SLIPPING)
            friction = force - force.dot(UP) * UP
            # mu N at each contact, against the slip
            self.assertAlmostEqual(numpy.linalg.norm(friction), mu * force.dot(UP), delta=rounding)
            self.assertLess(friction.dot(slip),
                            -0.999 * numpy.linalg.norm(friction) * numpy.linalg.norm(slip))
            self.assertAlmostEqual(slip.dot(DOWNHILL), speed, delta=rounding)

    def test_by_events_a_sliding_block_has_mu_n_against_its_slip(self):
        self.check_sliding("event_driven", 1e-9)

    def test_by_impulses_a_sliding_block_has_mu_n_against_its_slip(self):
        self.check_sliding("sequential_impulses", 0.02)

    def test_without_friction_contacts_are_closed(self):
        for force, _, contact in self.contacts("event_driven", 0.0, 20):
            self.assertEqual(contact.state, ContactForce.CLOSED)
            self.assertAlmostEqual(numpy.linalg.norm(force - force.dot(UP) * UP), 0.0, delta=1e-9)


if __name__ == "__main__":
    rospy.init_node("test_contact_forces")
    rostest.rosrun("constraint_sim", "contact_forces", Forces)
