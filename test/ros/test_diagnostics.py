#!/usr/bin/env python3
"""/diagnostics: three statuses a second, and the warnings of each."""
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from support import NODE, Listener, call, node_command, running, sphere, wait_until

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
PENDULUM = """
bodies: [{name: bob, mass: 1, position: [0, 0, -1]}]
constraints: [{name: rod, type: distance, body_b: bob}]
"""


def status(message, what, node=NODE):
    return next((s for s in message.status if s.name == "%s: %s" % (node, what)), None)


def values(found):
    return {pair.key: pair.value for pair in found.values}


class Diagnostics(unittest.TestCase):
    def setUp(self):
        call("pause_physics")
        self.assertTrue(call("load_scene", text=PENDULUM).success)
        self.listener = Listener("/diagnostics", DiagnosticArray)

    def tearDown(self):
        call("pause_physics")
        Listener.stop_all()

    def wait(self, what, level, condition=lambda s: True):
        message = self.listener.wait(
            lambda m: status(m, what) and status(m, what).level == level and
            condition(status(m, what)), "%s at level %d" % (what, level))
        return status(message, what)

    def test_all_is_well(self):
        call("unpause_physics")
        # in some second, since a busy machine drops ticks
        clock = self.wait("clock", OK, lambda s: s.message == "keeps up" and
                          abs(float(values(s)["real_time_factor"]) - 1.0) < 0.1)
        self.assertEqual(clock.hardware_id, NODE)
        self.wait("constraints", OK, lambda s: s.message == "hold")
        self.wait("physics", OK, lambda s: s.message == "goes on")

    def test_a_pause_is_no_fault(self):
        self.wait("clock", OK, lambda s: s.message == "stands")

    def test_a_node_that_does_not_keep_up_warns(self):
        with running(node_command(real_time_factor=1e6) + ["__name:=fast"]):
            self.listener.wait(
                lambda m: status(m, "clock", "/fast") and
                status(m, "clock", "/fast").level == WARN and
                "real-time factor" in status(m, "clock", "/fast").message and
                "ticks dropped" in status(m, "clock", "/fast").message, "the warning")

    def test_inconsistent_constraints_are_named(self):
        call("add_distance_constraint", name="longer", body_b="bob", length=1.5)
        call("unpause_physics")
        # after the closing time the mean of the two lengths remains
        found = self.wait("constraints", WARN, lambda s: "inconsistent" in s.message and
                          len(values(s)["inconsistent"].split(", ")) == 2)
        self.assertEqual(set(values(found)["inconsistent"].split(", ")), {"rod", "longer"})
        self.assertIn(values(found)["worst constraint"], ("rod", "longer"))
        self.assertGreater(float(values(found)["largest error [m]"]), 0.1)

    def test_a_motor_that_is_sent_to_a_position_is_no_error(self):
        self.assertTrue(call("load_scene", text="""
bodies: [{name: arm, mass: 1, shape: {box: {size: [0.5, 0.1, 0.1]}}, position: [0.25, 0, 0]}]
constraints:
- {name: hinge, type: hinge, axis_a: [0, 1, 0], body_b: arm, anchor_b: [-0.25, 0, 0], position: 0,
   motor: {position: -0.5}}
""").success)
        call("unpause_physics")
        self.wait("constraints", OK, lambda s: values(s)["constraints"] == "1")
        start = len(self.listener.messages)
        wait_until(lambda: len(self.listener.messages) > start + 2, "three more messages")
        for message in self.listener.messages[start - 1:]:
            self.assertEqual(status(message, "constraints").level, OK)

    def test_the_threshold_of_errors_is_a_parameter(self):
        with running(node_command(scene="pendulum", diagnostics_constraint_error=1e-20) +
                     ["__name:=strict"]):
            self.listener.wait(
                lambda m: status(m, "constraints", "/strict") and
                status(m, "constraints", "/strict").level == WARN, "the warning")

    def test_events_and_what_they_cost_are_counted(self):
        """A ball that bounces for ever has an event for each bounce, with substeps."""
        self.assertTrue(call("load_scene", text="""
bodies:
- {name: floor, type: static, shape: {plane: {}}, friction: 0.5, restitution: 1}
- {name: ball, mass: 1, position: [0, 0, 0.6], shape: {sphere: {radius: 0.5}}, friction: 0.5,
   restitution: 1}
""").success)
        call("unpause_physics")
        found = self.wait("physics", OK, lambda s: int(values(s)["events in this second"]) >= 2)
        self.assertGreater(int(values(found)["substeps in this second"]),
                           int(values(found)["events in this second"]))

    def test_the_threshold_of_the_pace_is_a_parameter(self):
        """A million times real time is out of reach: threshold 0 requires nothing, so that only dropped
        ticks are reported."""
        with running(node_command(scene="pendulum", real_time_factor=1e6,
                                  diagnostics_real_time_factor=0.0) + ["__name:=patient"]):
            self.listener.wait(
                lambda m: status(m, "clock", "/patient") and
                float(values(status(m, "clock", "/patient"))["real_time_factor"]) > 0.0 and
                "real-time factor" not in status(m, "clock", "/patient").message, "no such warning")

    def test_a_failure_is_an_error(self):
        body = sphere("fast", 1e20)
        body.twist.linear.x = 1e20
        call("add_body", body=body)
        call("unpause_physics")
        found = self.wait("physics", ERROR)
        self.assertIn("fast", found.message)
        self.assertEqual(values(found)["failed"], "true")


if __name__ == "__main__":
    rospy.init_node("test_diagnostics")
    rostest.rosrun("constraint_sim", "diagnostics", Diagnostics)
