#!/usr/bin/env python3
"""Real time, simulated time, and time that stands, drops out or goes back."""
import os
import signal
import subprocess
import threading
import time
import unittest

import rospy
import rostest
from constraint_sim.msg import BodyStates, Statistics
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

import support
from support import Listener, call, node_command, properties, running, sphere

# A tf2 listener of its own, whose log says what it thinks of the transforms
TF_LISTENER = """
import rospy, tf2_ros
rospy.init_node("tf_listener")
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer)
rospy.spin()
"""
TF_COMPLAINTS = ("TF_OLD_DATA", "TF_REPEATED_DATA")


class Followed:
    """A /clock that the test drives: 100 Hz from a start, at a rate, until it is stopped."""

    def __init__(self, start):
        self.now = start
        self.rate = 1.0
        self._topic = rospy.Publisher("/clock", Clock, queue_size=10)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stop.wait(0.01):
            self.now += 0.01 * self.rate
            self._topic.publish(rospy.Time.from_sec(self.now))

    def stop(self):
        self._stop.set()
        self._thread.join()
        self._topic.unregister()


class Time(unittest.TestCase):
    def setUp(self):
        rospy.set_param("/use_sim_time", False)

    def tearDown(self):
        rospy.set_param("/use_sim_time", False)

    def gained(self, seconds):
        """How far simulated time goes in this wall time."""
        start, wall = properties().sim_time, time.monotonic()
        time.sleep(seconds)
        return (properties().sim_time - start) / (time.monotonic() - wall)

    # ---- the pace; bounds are wide, for a busy machine drops ticks and calls take their time

    def test_real_time_factor_is_kept(self):
        for factor in (1.0, 0.1):
            with running(node_command(scene="pendulum", real_time_factor=factor)):
                properties()
                self.assertAlmostEqual(self.gained(2.0) / factor, 1.0, delta=0.3)

    def test_real_time_factor_zero_is_as_fast_as_it_can(self):
        with running(node_command(scene="pendulum", real_time_factor=0)):
            properties()
            self.assertGreater(self.gained(1.0), 5.0)
            call("pause_physics")
            step = properties().step
            self.assertEqual(properties().step, step)

    def test_the_tick_may_change_while_running_and_time_is_continuous(self):
        with running(node_command(scene="pendulum")):
            listener = Listener(support.NODE + "/statistics", Statistics)
            listener.wait(lambda m: m.ticks > 0)
            before = properties()
            call("load_scene", text="world: {time_step: 0.0005}\nbodies: []")
            after = properties()
            self.assertEqual((before.time_step, after.time_step), (0.002, 0.0005))
            self.assertTrue(before.sim_time <= after.sim_time < before.sim_time + 2.0)
            self.assertAlmostEqual(self.gained(1.0), 1.0, delta=0.3)

    def test_what_cannot_be_kept_up_with_is_dropped_and_counted(self):
        with running(node_command(scene="falling_balls", real_time_factor=1000.0)):
            message = Listener(support.NODE + "/statistics", Statistics).wait(
                lambda m: m.dropped_ticks > 0, "dropped ticks")
            self.assertLess(message.real_time_factor, 1000.0)

    def test_it_survives_being_stopped_for_three_seconds(self):
        command = [subprocess.check_output(["catkin_find", "--first-only", "--libexec",
                                            "constraint_sim", "constraint_sim_node"],
                                           universal_newlines=True).strip()]
        command += node_command(scene="pendulum")[3:]
        listener = Listener("/tf", TFMessage)
        with running(command) as process:
            before = properties().sim_time
            process.send_signal(signal.SIGSTOP)
            time.sleep(3.0)
            process.send_signal(signal.SIGCONT)
            listener.wait(what="a transform after the stop")
            after = properties().sim_time
            self.assertLess(after - before, 2.0)  # the time stopped is not made up for
            statistics = Listener(support.NODE + "/statistics", Statistics)
            message = statistics.wait(lambda m: m.dropped_ticks > 0)
            self.assertGreater(message.dropped_ticks, 1000)  # of 1500 in 3 s
            late = listener.wait().transforms[0].header.stamp
            self.assertLess(abs(time.time() - late.to_sec()), 2.0)
        stamps = [m.transforms[0].header.stamp for m in listener.messages]
        self.assertTrue(all(a < b for a, b in zip(stamps, stamps[1:])))

    # ---- simulated time

    def test_publish_clock(self):
        clock = Listener("/clock", Clock)
        with running(node_command(scene="pendulum", publish_clock="true")):
            support.wait_until(lambda: len(clock.messages) > 200, "the clock")
            call("pause_physics")
            states = Listener(support.NODE + "/body_states", BodyStates)
            stamp = states.wait().header.stamp
            self.assertAlmostEqual(stamp.to_sec(), properties().sim_time, places=6)
            paused_at = len(clock.messages)
            support.wait_until(lambda: len(clock.messages) >= paused_at + 2, "the clock's repetition")
            self.assertEqual(clock.messages[-1].clock, clock.messages[-2].clock)
            times = [m.clock for m in clock.messages]
            self.assertTrue(all(t > rospy.Time(0) for t in times))
            self.assertEqual(times, sorted(times))
            call("reset_simulation")
            support.wait_until(lambda: clock.messages[-1].clock < times[-1], "the clock set back")
            self.assertGreater(clock.messages[-1].clock, rospy.Time(0))

    def test_it_follows_a_clock_stops_with_it_and_goes_back_with_it(self):
        rospy.set_param("/use_sim_time", True)
        clock = Followed(5000.0)
        try:
            with running(node_command(scene="pendulum")):
                support.wait_until(lambda: properties().sim_time > 5000.0, "the clock's time")
                for rate in (1.0, 3.0):
                    clock.rate = rate
                    self.assertAlmostEqual(self.gained(1.5) / rate, 1.0, delta=0.3)
                self.assertLess(abs(properties().sim_time - clock.now), 2.0)
                clock.rate = 0.0
                support.wait_until(lambda: properties().step == (time.sleep(0.3), properties().step)[1],
                                   "it stands with the clock")
                states = Listener(support.NODE + "/body_states", BodyStates)
                stamp = states.wait().header.stamp.to_sec()
                self.assertAlmostEqual(stamp, properties().sim_time, places=5)
                clock.now, clock.rate = 100.0, 1.0
                support.wait_until(lambda: 100.0 <= properties().sim_time < 200.0, "the way back")
        finally:
            clock.stop()

    # ---- what tf2 thinks of it

    def check_tf(self, **parameters):
        """No complaint in a listener's log over pause, edits, resets and another scene."""
        with running(["/usr/bin/python3", "-c", TF_LISTENER], stdout=subprocess.PIPE,
                     stderr=subprocess.STDOUT, universal_newlines=True) as listener:
            with running(node_command(scene="pendulum", **parameters)):
                states = Listener(support.NODE + "/body_states", BodyStates)
                transforms = Listener("/tf", TFMessage)

                def goes_on():
                    states.wait(what="states")
                    transforms.wait(what="transforms")

                goes_on()
                for action in (lambda: call("pause_physics"),
                               lambda: call("add_body", body=sphere("b", 0, 0, 9)),
                               lambda: call("step", steps=3),
                               lambda: call("reset_world"),
                               lambda: call("remove_body", name="b"),
                               lambda: call("reset_simulation"),
                               lambda: call("unpause_physics"),
                               lambda: call("reset_world"),
                               lambda: call("reset_simulation"),
                               lambda: call("load_scene", path="double_pendulum")):
                    action()
                    goes_on()
            os.killpg(listener.pid, signal.SIGINT)
            log = listener.communicate(timeout=support.TIMEOUT)[0]
        for complaint in TF_COMPLAINTS:
            self.assertNotIn(complaint, log)

    def test_tf_has_no_complaint_in_wall_time(self):
        self.check_tf()

    def test_tf_has_no_complaint_in_simulated_time(self):
        rospy.set_param("/use_sim_time", True)
        self.check_tf(publish_clock="true")


if __name__ == "__main__":
    rospy.init_node("test_time")
    rostest.rosrun("constraint_sim", "time", Time)
