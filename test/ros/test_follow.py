#!/usr/bin/env python3
"""Kinematic bodies that follow frames of tf, in simulated time, so that each run is equal."""
import math
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from rosgraph_msgs.msg import Log
from tf2_msgs.msg import TFMessage

import support
from support import Listener, call, node_command, running

TICK, SAMPLE, DELAY = 0.005, 0.02, 0.1  # [s]
SWING, RATE, LENGTH = 0.3, 2.0, 1.0     # [m], [rad/s], [m]
SCENE = """
world: {time_step: %g}
bodies:
  - {name: hook, type: kinematic, shape: {sphere: {radius: 0.05}}, position: [5, 0, 3]}
  - {name: load, mass: 5, shape: {sphere: {radius: 0.1}}, position: [5, 0, 2]}
constraints:
  - {name: tether, type: distance, body_a: hook, body_b: load, length: %g}
""" % (TICK, LENGTH)


def carrier(t):
    """Returns the pose of the frame: x [m] and its angle about z [rad]."""
    return SWING * (1.0 - math.cos(RATE * t)), 0.5 * math.sin(t)


def transforms(start, end):
    """Returns transforms of the frame at each SAMPLE, as another node would send them."""
    message = TFMessage()
    for i in range(round(start / SAMPLE), round(end / SAMPLE) + 1):
        t = i * SAMPLE
        x, angle = carrier(t)
        each = TransformStamped(child_frame_id="carrier")
        each.header.frame_id = "world"
        each.header.stamp = rospy.Time.from_sec(t) if t > 0 else rospy.Time(0, 1)
        each.transform.translation.x, each.transform.translation.z = x, 3.0
        each.transform.rotation.z = math.sin(angle / 2)
        each.transform.rotation.w = math.cos(angle / 2)
        message.transforms.append(each)
    return message


def between(t):
    """Returns the frame's position in tf between two transforms: on the chord."""
    before = math.floor(t / SAMPLE + 1e-9) * SAMPLE
    share = (t - before) / SAMPLE
    return (1 - share) * carrier(before)[0] + share * carrier(before + SAMPLE)[0]


def swinging_load(start, end):
    """Returns x of a load at rest below the frame at `start`, which then moves: a pendulum on a driven
    point, by the Runge-Kutta method in steps of 0.1 ms."""
    def rate(t, y):
        pull = SWING * RATE ** 2 * math.cos(RATE * t)
        return y[1], -(9.81 * math.sin(y[0]) + pull * math.cos(y[0])) / LENGTH
    # the frame moves at once: the load keeps its velocity of 0
    velocity = SWING * RATE * math.sin(RATE * start)
    y, steps = (0.0, -velocity / LENGTH), round((end - start) / 1e-4)
    h = (end - start) / steps
    for i in range(steps):
        t = start + i * h
        k1 = rate(t, y)
        k2 = rate(t + h / 2, [a + h / 2 * k for a, k in zip(y, k1)])
        k3 = rate(t + h / 2, [a + h / 2 * k for a, k in zip(y, k2)])
        k4 = rate(t + h, [a + h * k for a, k in zip(y, k3)])
        y = [a + h / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(y, k1, k2, k3, k4)]
    return carrier(end)[0] + LENGTH * math.sin(y[0])


class Follow(unittest.TestCase):
    def setUp(self):
        self.publisher = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self.log = Listener("/rosout", Log)

    def tearDown(self):
        Listener.stop_all()

    def start(self, follow="hook=carrier"):
        parameters = {"follow": follow, "follow_delay": DELAY, "publish_clock": "true",
                      "paused": "true"}
        return running(node_command(**parameters))

    def load(self):
        # log lines before the connection are lost
        support.wait_until(lambda: "/rosout" in support.topics_between(
            support.NODE, rospy.get_name()), "the node's /rosout")
        answer = call("load_scene", text=SCENE)
        self.assertTrue(answer.success, answer.status_message)

    def send(self, start, end):
        """Sends transforms until the node has them: it has an own subscriber for tf."""
        support.wait_until(lambda: self.publisher.get_num_connections() > 0, "the node on /tf")
        self.publisher.publish(transforms(start, end))

    def step_until(self, time):
        """Steps to that time; returns the states by name."""
        steps = round((time - call("get_world_properties").sim_time) / TICK)
        answer = call("step", steps=steps)
        self.assertTrue(answer.success, answer.status_message)
        return {body.name: body for body in answer.bodies}

    def said(self, *words):
        return next((m for m in self.log.messages if all(w in m.msg for w in words)), None)

    def arrive(self, time):
        """Steps single ticks until the frame is known."""
        def is_there():
            hook = self.step_until(call("get_world_properties").sim_time + TICK)["hook"]
            return hook.pose.position.x < 4.0
        support.wait_until(is_there, "the frame")

    def test_the_body_is_where_tf_has_the_frame_and_joints_hold(self):
        with self.start():
            self.load()
            self.step_until(0.2)  # so that the requested time of the frame exists
            self.send(0.0, 8.0)
            self.arrive(0.5)
            began = call("get_world_properties").sim_time
            while call("get_world_properties").sim_time < began + 2.0 - 1e-9:
                now = call("get_world_properties").sim_time + 0.1
                hook = self.step_until(now)["hook"]
                # times of stamps are whole nanoseconds
                self.assertAlmostEqual(hook.pose.position.x, between(now - DELAY), delta=1e-8)
                chord = 0.125 * 0.5 * SAMPLE ** 2  # chord of sin t / 2 between two transforms
                angle = 2 * math.atan2(hook.pose.orientation.z, hook.pose.orientation.w)
                self.assertAlmostEqual(angle, carrier(now - DELAY)[1], delta=2 * chord)
            states = call("get_body_state", name="load").state.pose.position
            hook = call("get_body_state", name="hook").state.pose.position
            length = math.dist((states.x, states.y, states.z), (hook.x, hook.y, hook.z))
            self.assertAlmostEqual(length, LENGTH, delta=1e-12)

    def test_a_tethered_load_swings_as_below_a_driven_point(self):
        with self.start():
            self.load()
            # the load hangs below the frame's place, at rest, before the frame arrives
            self.send(0.0, 8.0)
            self.assertTrue(call("pause_physics") is not None)
            self.step_until(DELAY + TICK)
            self.arrive(0.5)
            # restarts here: at rest, below the frame
            begin = call("get_world_properties").sim_time
            hook = call("get_body_state", name="hook").state
            load = call("get_body_state", name="load").state
            load.pose.position.x, load.pose.position.z = hook.pose.position.x, 2.0
            load.twist.linear.x = load.twist.linear.z = 0.0
            self.assertTrue(call("set_body_state", state=load).success)
            end = begin + 2.0
            states = self.step_until(end)
            expected = swinging_load(begin - DELAY, end - DELAY)
            # the frame moves on chords: its velocity error is half a SAMPLE of its acceleration
            self.assertAlmostEqual(states["load"].pose.position.x, expected,
                                   delta=SWING * RATE ** 2 * SAMPLE * 0.5)

    def test_a_frame_that_no_longer_comes_is_told_and_the_body_stands(self):
        statuses = Listener("/diagnostics", DiagnosticArray)
        with self.start():
            self.load()
            self.step_until(0.2)
            self.send(0.0, 1.0)
            self.arrive(0.5)
            last = self.step_until(2.0)["hook"].pose.position.x
            self.assertAlmostEqual(last, carrier(1.0)[0], delta=1e-8)  # last known position
            support.wait_until(lambda: self.said("no transform of 'carrier'", "'hook'"), "a warning")

            def warned(message):
                return any(s.name.endswith(": frames") and s.level == DiagnosticStatus.WARN and
                           "hook" in s.message for s in message.status)
            statuses.wait(warned, "a warning in /diagnostics")
            self.assertEqual(self.step_until(2.5)["hook"].pose.position.x, last)
            self.send(2.0, 4.0)
            support.wait_until(lambda: abs(
                self.step_until(call("get_world_properties").sim_time + TICK)
                ["hook"].pose.position.x - last) > 1e-6, "the frame again")
            now = call("get_world_properties").sim_time
            hook = call("get_body_state", name="hook").state.pose.position
            self.assertAlmostEqual(hook.x, between(now - DELAY), delta=1e-8)

    def test_a_body_does_not_rush_to_the_frame_when_time_jumps(self):
        with self.start():
            self.load()
            self.step_until(0.2)
            self.send(0.0, 2.0)
            self.arrive(0.5)
            self.step_until(1.5)
            call("reset_simulation")
            # at its start, 5 m from the frame's last place, until the frame is known
            hook = self.step_until(TICK)["hook"]
            self.assertEqual((hook.pose.position.x, hook.twist.linear.x), (5.0, 0.0))
            hook = self.step_until(DELAY + 2 * TICK)["hook"]
            self.assertLess(abs(hook.pose.position.x), 1e-3)
            self.assertLess(abs(hook.twist.linear.x), 1.0)

    def test_frames_in_a_loop_and_stamps_at_the_end_of_time_do_not_fail_the_physics(self):
        def transform(parent, child, stamp):
            each = TransformStamped(child_frame_id=child)
            each.header.frame_id, each.header.stamp = parent, stamp
            each.transform.rotation.w = 1.0
            return each

        with self.start() as process:
            self.load()
            self.step_until(0.2)
            self.send(0.0, 0.5)
            self.arrive(0.5)
            for late in (rospy.Time(4294967295, 999999999), rospy.Time(4294967290)):
                self.publisher.publish(TFMessage([transform("world", "carrier", late)]))
            support.wait_until(lambda: self.said("/tf", "'carrier'", "too late"), "a warning")
            self.send(0.52, 1.0)  # arrives nevertheless
            now = call("get_world_properties").sim_time

            def follows():
                hook = self.step_until(call("get_world_properties").sim_time + TICK)["hook"]
                return hook.twist.linear.x > 0.0
            support.wait_until(follows, "the body on its way")
            # the frame hangs on a frame that hangs on it
            loop = [transform(*pair, rospy.Time.from_sec(t)) for t in (now + 2, now + 60)
                    for pair in (("other", "carrier"), ("carrier", "other"))]
            self.publisher.publish(TFMessage(loop))

            def stands():
                hook = self.step_until(call("get_world_properties").sim_time + 0.5)["hook"]
                return hook.twist.linear.x == 0.0
            support.wait_until(stands, "the body at rest")
            self.step_until(now + 3)  # where the frames form a loop
            self.assertIsNone(process.poll())

    def test_what_cannot_follow_is_told(self):
        with self.start(follow="load=carrier nobody=carrier"):
            self.load()
            self.step_until(0.05)
            support.wait_until(lambda: self.said("'load' cannot follow", "not kinematic"), "why")
            support.wait_until(lambda: self.said("'nobody' cannot follow"), "why")


if __name__ == "__main__":
    rospy.init_node("test_follow")
    rostest.rosrun("constraint_sim", "follow", Follow)
