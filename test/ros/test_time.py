#!/usr/bin/env python3
"""Real time, simulated time, and time that stands, jumps or goes back."""
import contextlib
import csv
import os
import signal
import subprocess
import tempfile
import threading
import time
import unittest

import rosbag
import rospkg
import rospy
import rostest
from constraint_sim.msg import BodyStates, Statistics
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

import support
from support import Listener, call, node_command, properties, running, sphere
from test_log import speaking

# A separate tf2 listener, whose log has its complaints about transforms.
TF_LISTENER = """
import rospy, tf2_ros
rospy.init_node("tf_listener")
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer)
rospy.spin()
"""
TF_COMPLAINTS = ("TF_OLD_DATA", "TF_REPEATED_DATA")

PENDULUM = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "config", "scenes",
                        "pendulum.yaml")
# A body whose position is the simulated time since it was loaded.
PACER = """
world: {time_step: 0.002}
bodies: [{name: pacer, type: kinematic, linear_velocity: [1, 0, 0]}]"""


@contextlib.contextmanager
def tf_listener():
    """Runs a tf2 listener that must not have complained when the block ends."""
    with running(["/usr/bin/python3", "-c", TF_LISTENER], stdout=subprocess.PIPE,
                 stderr=subprocess.STDOUT, universal_newlines=True) as listener:
        support.wait_until(lambda: "/tf_listener" in subscribers("/tf"), "the listener")
        yield
        os.killpg(listener.pid, signal.SIGINT)
        log = listener.communicate(timeout=support.TIMEOUT)[0]
    for complaint in TF_COMPLAINTS:
        assert complaint not in log, log


def subscribers(topic):
    _, all_subscribers, _ = rospy.get_master().getSystemState()[2]
    return dict(all_subscribers).get(topic, [])


def stands(periods=10):
    """Returns whether the world makes no tick during this number of publishing periods."""
    statistics = Listener(support.NODE + "/statistics", Statistics)
    support.wait_until(lambda: len(statistics.messages) >= periods, "statistics")
    return all(m.ticks == 0 for m in statistics.messages)


def places_of_pendulum(seconds):
    """Returns the positions of the pendulum's bob after each step, by the runner."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "states.csv")
        subprocess.check_call(["rosrun", "constraint_sim", "constraint_sim_run", PENDULUM,
                               "--duration", str(seconds), "--csv", path],
                              stdout=subprocess.DEVNULL)
        with open(path) as states:
            return [[float(row[axis]) for axis in ("px", "py", "pz")]
                    for row in csv.DictReader(states)]


class Followed:
    """A /clock that the test drives: 100 Hz from a start, at a rate, until it is stopped."""

    def __init__(self, start):
        self.now = start
        self.rate = 1.0
        self._topic = rospy.Publisher("/clock", Clock, queue_size=10)
        self._lock = threading.Lock()  # protects the time, which jump() sets
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stop.wait(0.01):
            with self._lock:
                self.now += 0.01 * self.rate
            self._topic.publish(rospy.Time.from_sec(self.now))

    def jump(self, now):
        with self._lock:
            self.now = now

    def stop(self):
        self._stop.set()
        self._thread.join()
        self._topic.unregister()


class Time(unittest.TestCase):
    def setUp(self):
        rospy.set_param("/use_sim_time", False)

    def tearDown(self):
        Listener.stop_all()
        rospy.set_param("/use_sim_time", False)

    def pace(self, tick, seconds, clock=time.monotonic):
        """Returns simulated time over that of a clock, for this number of its seconds. Dropped ticks count
        too, so that only the delay of two messages matters."""
        statistics = Listener(support.NODE + "/statistics", Statistics)
        first, start = statistics.wait(lambda m: m.ticks > 0, "a tick"), clock()
        support.wait_until(lambda: clock() > start + seconds, "the clock")
        last, end = statistics.wait(what="some ticks more"), clock()
        due = (last.step + last.dropped_ticks) - (first.step + first.dropped_ticks)
        return due * tick / (end - start)

    def check_pace(self, expected, *arguments):
        """Expects the pace in some trial: a machine that pauses spoils one figure, not all."""
        paces = []

        def is_kept():
            paces.append(self.pace(*arguments))
            return abs(paces[-1] / expected - 1.0) < 0.3
        support.wait_until(is_kept, "a pace of %g" % expected)

    # ---- the pace

    def test_real_time_factor_is_kept(self):
        for factor in (1.0, 0.1):
            with running(node_command(scene="pendulum", real_time_factor=factor)):
                properties()
                self.check_pace(factor, 0.002, 1.0)

    def test_real_time_factor_zero_is_as_fast_as_it_can(self):
        with running(node_command(scene="pendulum", real_time_factor=0)):
            properties()
            self.assertGreater(self.pace(0.002, 1.0), 5.0)
            call("pause_physics")
            step = properties().step
            self.assertEqual(properties().step, step)

    def test_the_tick_may_change_while_running_and_time_is_continuous(self):
        with running(node_command(scene="pendulum")):
            listener = Listener(support.NODE + "/statistics", Statistics)
            listener.wait(lambda m: m.ticks > 0)
            before = properties()
            loaded = call("load_scene", text="world: {time_step: 0.0005}\nbodies: []")
            after = properties()
            self.assertEqual((before.time_step, after.time_step), (0.002, 0.0005))
            ticks = 0.002 * (loaded.step - before.step) + 0.0005 * (after.step - loaded.step)
            self.assertAlmostEqual(after.sim_time - before.sim_time, ticks, places=9)
            self.check_pace(1.0, 0.0005, 1.0)

    def test_what_cannot_be_kept_up_with_is_dropped_and_counted(self):
        with running(node_command(scene="platform", real_time_factor=1000.0)):
            Listener(support.NODE + "/statistics", Statistics).wait(
                lambda m: m.dropped_ticks > 0, "dropped ticks")
            # completed and dropped ticks are all due ticks
            self.check_pace(1000.0, properties().time_step, 1.0)

    def test_it_survives_being_stopped_for_a_second(self):
        listener = Listener("/tf", TFMessage)
        with running(node_command(scene="pendulum")) as process:
            start = time.monotonic()
            before = properties().sim_time
            process.send_signal(signal.SIGSTOP)
            time.sleep(1.0)  # time to be dropped
            going_on = time.time()
            process.send_signal(signal.SIGCONT)
            listener.wait(what="a transform after the stop")
            after = properties().sim_time
            # stopped time is not made up for, except 0.1 s
            self.assertLess(after - before, time.monotonic() - start - 0.8)
            statistics = Listener(support.NODE + "/statistics", Statistics)
            statistics.wait(lambda m: m.dropped_ticks > 400, "dropped ticks, of 500 in a second")
            late = listener.wait().transforms[0].header.stamp.to_sec()
            self.assertTrue(going_on - 0.5 < late < time.time() + 0.5, late - going_on)
        stamps = [m.transforms[0].header.stamp for m in listener.messages]
        self.assertTrue(all(a < b for a, b in zip(stamps, stamps[1:])))

    # ---- simulated time

    def test_publish_clock(self):
        clock = Listener("/clock", Clock)
        with running(node_command(scene="pendulum", publish_clock="true")):
            support.wait_until(lambda: len(clock.messages) > 200, "the clock")
            call("pause_physics")
            states = Listener(support.NODE + "/body_states", BodyStates)
            stood = properties().sim_time
            states.wait(lambda m: abs(m.header.stamp.to_sec() - stood) < 1e-6, "the time it stands at")
            support.wait_until(lambda: clock.messages[-1].clock == clock.messages[-2].clock,
                               "the clock's repetition")
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
                    self.check_pace(1.0, 0.002, 1.5 * rate, lambda: clock.now)
                support.wait_until(lambda: abs(properties().sim_time - clock.now) < 2.0,
                                   "the time of the clock")
                clock.rate = 0.0
                support.wait_until(stands, "it stands with the clock")
                states = Listener(support.NODE + "/body_states", BodyStates)
                stamp = states.wait().header.stamp.to_sec()
                self.assertAlmostEqual(stamp, properties().sim_time, places=5)
                clock.now, clock.rate = 100.0, 1.0
                support.wait_until(lambda: 100.0 <= properties().sim_time < 200.0, "the way back")
        finally:
            clock.stop()

    def test_stamps_follow_a_clock_that_jumps_and_the_log_names_the_jump(self):
        rospy.set_param("/use_sim_time", True)
        clock = Followed(100.0)
        states = Listener(support.NODE + "/body_states", BodyStates)
        transforms = Listener("/tf", TFMessage)
        statistics = Listener(support.NODE + "/statistics", Statistics)

        def follows(listener):
            """Returns whether the last stamp is the clock's, within the delay of two messages."""
            return abs(support.stamp_of(listener.messages[-1]).to_sec() - clock.now) < 0.5
        try:
            with speaking(node_command(scene="pendulum")) as log:
                support.wait_until(lambda: properties().sim_time > 100.0, "the clock's time")
                for place in (5000.0, 200.0, 1e6):
                    clock.jump(place)
                    for listener in (states, transforms):
                        support.wait_until(lambda: follows(listener), "the stamps at %g s" % place)
                    self.assertTrue(abs(properties().sim_time - clock.now) < 0.5)
                log.wait("WARN", "/clock jumped forward by 4", "to 5000.")
                log.wait("INFO", "/clock went back by 4", "to 200.")
                self.assertEqual(log.lines("machine"), [])
        finally:
            clock.stop()
        # a jump does not count as speed
        self.assertLess(max(m.real_time_factor for m in statistics.messages), 100.0)

    def test_stamps_follow_the_clock_again_after_a_pause_and_a_reset(self):
        rospy.set_param("/use_sim_time", True)
        clock = Followed(100.0)
        states = Listener(support.NODE + "/body_states", BodyStates)
        near = lambda: abs(support.stamp_of(states.messages[-1]).to_sec() - clock.now) < 0.5
        try:
            with running(node_command(scene="pendulum")):
                support.wait_until(lambda: properties().sim_time > 100.0, "the clock's time")
                call("pause_physics")
                stood = properties().sim_time
                clock.rate = 10.0
                support.wait_until(lambda: clock.now > stood + 10.0, "the clock")
                self.assertEqual(properties().sim_time, stood)
                clock.rate = 1.0
                call("unpause_physics")
                support.wait_until(near, "the clock's stamps after a pause")
                call("reset_simulation")
                support.wait_until(lambda: abs(properties().sim_time - clock.now) < 0.5,
                                   "the clock's time after a reset")
                states.wait()
                support.wait_until(near, "the clock's stamps after a reset")
        finally:
            clock.stop()

    def test_it_follows_a_played_bag(self):
        rospy.set_param("/use_sim_time", True)
        start, seconds, tick = 1000.0, 6.0, 0.002
        places = places_of_pendulum(seconds)
        clock, played = Listener("/clock", Clock), Listener("/played", String)
        states = Listener(support.NODE + "/body_states", BodyStates)
        statistics = Listener(support.NODE + "/statistics", Statistics)

        def stands_at_the_clock():
            """Returns properties, once the world has done or dropped every whole tick of the clock."""
            found = statistics.wait(lambda m: m.ticks == 0, "a world that stands")
            late = clock.messages[-1].clock.to_sec() - found.sim_time.to_sec()
            # a standing clock is repeated; rounding is far below 1e-6 s
            return (clock.messages[-1] == clock.messages[-2] and -1e-6 < late < tick + 1e-6 and
                    properties())

        def check_it_stands_there():
            stood = support.wait_until(stands_at_the_clock, "the clock's time")
            ticks = stood.step + statistics.messages[-1].dropped_ticks
            self.assertAlmostEqual(stood.sim_time, start + ticks * tick, places=6)
            answer = call("get_body_state", name="bob")
            self.assertAlmostEqual(answer.header.stamp.to_sec(), stood.sim_time, places=6)
            self.assertTrue(stands())
            self.assertEqual(properties().state_hash, stood.state_hash)
            return stood.step

        def play_until(bag_time):
            call("/player/pause_playback", data=False)
            support.wait_until(lambda: clock.messages[-1].clock.to_sec() > start + bag_time,
                               "the bag's time")
            call("/player/pause_playback", data=True)

        with tempfile.TemporaryDirectory() as folder:
            with rosbag.Bag(folder + "/a.bag", "w") as bag:
                for i in range(round(seconds * 10) + 1):
                    bag.write("/played", String(str(i)), rospy.Time.from_sec(start + 0.1 * i))
            # it begins paused, and is played when all are connected, so that nothing is lost
            player_command = ["rosbag", "play", "--clock", "--rate=2", "--pause",
                              "--wait-for-subscribers", folder + "/a.bag", "__name:=player"]
            with tf_listener(), running(node_command(scene="pendulum")):
                states.wait(what="states without a clock")
                self.assertEqual((properties().step, properties().sim_time), (0, 0.0))
                with running(player_command, stdin=subprocess.DEVNULL) as player:
                    support.wait_until(lambda: properties().sim_time == start, "the bag's start")
                    steps = [check_it_stands_there()]
                    for bag_time in (1.5, 3.5):
                        play_until(bag_time)
                        steps.append(check_it_stands_there())
                        support.wait_until(lambda: len(played.messages) > 10 * bag_time,
                                           "what was played")
                    call("/player/pause_playback", data=False)
                    support.wait_until(lambda: player.poll() is not None, "the bag's end")
                    self.assertEqual(player.returncode, 0)
                support.wait_until(stands, "it stands with the bag")
                end = properties()
        # while the bag played the world went on; the last clock may be lost with the player
        self.assertEqual(steps[0], 0)
        self.assertTrue(steps[0] < steps[1] < steps[2] < end.step)
        self.assertLess(end.sim_time, start + seconds + tick)
        # published positions equal the engine's at that time, in order
        stamps = [m.header.stamp for m in states.messages]
        self.assertTrue(all(a < b for a, b in zip(stamps, stamps[1:])))
        followed = [m for m in states.messages if m.header.stamp.to_sec() >= start]
        self.assertGreater(len({m.header.stamp for m in followed}), 20)
        # a busy machine drops ticks, and positions then have fewer steps than stamps say
        dropped = any(m.dropped_ticks for m in statistics.messages)
        for message in [] if dropped else followed:
            step = round((message.header.stamp.to_sec() - start) / tick)
            place = message.bodies[0].pose.position
            for found, expected in zip((place.x, place.y, place.z), places[step]):
                self.assertAlmostEqual(found, expected, places=12)

    # ---- the stamp of an answer

    def pacer(self):
        """Returns the pacer's stamp and position, both in seconds, from get_body_state."""
        answer = call("get_body_state", name="pacer")
        self.assertTrue(answer.success, answer.status_message)
        return answer.header.stamp.to_sec(), answer.state.pose.position.x

    def test_an_answer_is_stamped_with_the_wall_that_follows_simulated_time(self):
        states = Listener(support.NODE + "/body_states", BodyStates)

        def offsets():
            return [m.header.stamp.to_sec() - m.bodies[0].pose.position.x
                    for m in states.messages[-20:] if m.bodies]

        def same_stamp_as_topics():
            """Compares once no tick was dropped nearby, so that the topics' stamps are even."""
            before = offsets()
            stamp, place = self.pacer()
            for _ in range(2):  # the first may have been on its way
                states.wait()
            around = before + offsets()
            if len(before) < 10 or max(around) - min(around) > 1e-6:
                return False
            self.assertAlmostEqual(stamp - place, around[0], delta=2e-6)
            return True

        with running(node_command()):
            call("load_scene", text=PACER)
            for _ in range(5):
                support.wait_until(same_stamp_as_topics, "even stamps")
            call("pause_physics")
            states.wait()
            before = time.time()
            stamp = self.pacer()[0]
            self.assertTrue(before - 1e-6 <= stamp <= time.time() + 1e-6)
            # a pause without subscribers shows in no stamp
            call("unpause_physics")
            states.wait()
            Listener.stop_all()
            support.wait_until(lambda: not support.topics_between(support.NODE, rospy.get_name()) &
                               {support.NODE + "/body_states"}, "the node without listeners")
            call("pause_physics")
            time.sleep(1.0)  # delay that stamps would show
            going_on = time.time()
            call("unpause_physics")
            message = Listener(support.NODE + "/body_states", BodyStates).wait()
            for stamp in (message.header.stamp.to_sec(), self.pacer()[0]):
                self.assertTrue(going_on - 0.5 < stamp < time.time() + 0.5, stamp - going_on)

    def test_an_answer_is_stamped_with_simulated_time_where_that_is_published(self):
        with running(node_command(publish_clock="true")):
            loaded_at = call("load_scene", text=PACER).applied_at.to_sec()
            for _ in range(20):
                stamp, place = self.pacer()
                self.assertAlmostEqual(stamp, loaded_at + place, places=6)

    # ---- what tf2 thinks of it

    def check_tf(self, **parameters):
        """Expects no complaint over pause, edits, resets and another scene."""
        with tf_listener(), running(node_command(scene="pendulum", **parameters)):
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

    def test_tf_has_no_complaint_in_wall_time(self):
        self.check_tf()

    def test_tf_has_no_complaint_in_simulated_time(self):
        rospy.set_param("/use_sim_time", True)
        self.check_tf(publish_clock="true")


if __name__ == "__main__":
    rospy.init_node("test_time")
    rostest.rosrun("constraint_sim", "time", Time)
