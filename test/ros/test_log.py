#!/usr/bin/env python3
"""Log lines of the node, in its output and on /rosout, and reasons for not starting."""
import contextlib
import os
import subprocess
import tempfile
import unittest

import rospy
import rostest
from constraint_sim.msg import Statistics
from rosgraph_msgs.msg import Clock, Log

import support
from support import NODE, Listener, call, node_command, properties, running, sphere, wait_until

RUN = [support.node_program(), "__name:=constraint_sim"]


class NodeLog:
    """The output of a node. /rosout would lose lines before the subscriber is connected."""

    def __init__(self, path):
        self._path = path

    def lines(self, *words):
        """Returns the lines with all these words."""
        with open(self._path) as file:
            return [line for line in file.read().splitlines() if all(word in line for word in words)]

    def wait(self, level, *words):
        """Waits for a line of this level with all these words."""
        wait_until(lambda: any(level + "]" in line for line in self.lines(*words)),
                   "a line of %s with %s" % (level, words))


@contextlib.contextmanager
def speaking(command):
    """Runs the node and keeps its output."""
    environment = dict(os.environ, ROSCONSOLE_STDOUT_LINE_BUFFERED="1",
                       ROSCONSOLE_FORMAT="[${severity}] ${message}")
    with tempfile.NamedTemporaryFile() as output:
        with running(command, stdout=output, stderr=subprocess.STDOUT, env=environment):
            yield NodeLog(output.name)


class NodeSpeaks(unittest.TestCase):
    def setUp(self):
        rospy.set_param("/use_sim_time", False)
        if rospy.has_param(NODE):
            rospy.delete_param(NODE)

    def tearDown(self):
        rospy.set_param("/use_sim_time", False)

    def test_start_loads_broken_constraints_and_failures(self):
        with speaking(node_command(scene="pendulum", paused="true")) as log:
            log.wait("INFO", "pendulum", "1 body", "1 constraint", "tick 0.002 s", "runge_kutta")
            call("load_scene", path="winch")
            log.wait("INFO", "winch", "2 bodies", "event_driven")

            call("load_scene", text="""
bodies: [{name: load, mass: 1, position: [0, 0, -1]}]
constraints: [{name: thread, body_b: load, break_force: 1}]""")
            call("step", steps=10)
            log.wait("WARN", "broken", "'thread'")
            self.assertEqual(len(log.lines("broken")), 1)

            body = sphere("fast", 1e20)
            body.twist.linear.x = 1e20
            call("add_body", body=body)
            call("unpause_physics")
            log.wait("ERROR", "failed", "'fast'")
            call("unpause_physics")
            log.wait("WARN", "unpause_physics", "failed", "'fast'")
            call("remove_body", name="fast")
            log.wait("INFO", "goes on")

    def test_what_a_step_reports_is_told_when_it_begins_and_when_it_ends(self):
        with speaking(node_command(paused="true")) as log:
            call("unpause_physics")
            call("load_scene", path="heavy_load")  # its light bars vibrate faster than its tick
            log.wait("WARN", "'bar_1'", "time_step")
            call("load_scene", path="pendulum")
            log.wait("INFO", "shows the motion")
            self.assertEqual(len(log.lines("'bar_1'")), 1)

    def test_errors_that_are_not_closed_and_energy_without_a_cause_are_named_once(self):
        with speaking(node_command(paused="true", real_time_factor=0)) as log:
            call("unpause_physics")
            call("load_scene", text="""
bodies: [{name: bob, mass: 1, position: [0, 0, -1.1]}]
constraints:
  - {name: short, body_b: bob, length: 1}
  - {name: long, body_b: bob, length: 1.2}""")
            log.wait("WARN", "not being closed", "'short', 'long'")
            statistics = Listener(NODE + "/statistics", Statistics)
            wait_until(lambda: any(message.worst_constraint in ("short", "long")
                                   for message in statistics.messages), "the worst constraint")
            call("load_scene", text="""
world: {time_step: 0.2, tolerance: 0, method: runge_kutta}
bodies:
  - {name: upper, mass: 1, position: [1, 0, 0]}
  - {name: lower, mass: 1, position: [2, 0, 0]}
constraints:
  - {name: rod_1, body_b: upper}
  - {name: rod_2, body_a: upper, body_b: lower}""")
            log.wait("INFO", "closed, or are being closed, again")
            log.wait("WARN", "'upper'", "energy", "without a cause")
            self.assertEqual(len(log.lines("errors that are not being closed")), 1)

    def test_dropped_ticks(self):
        command = node_command(scene="platform", real_time_factor=1000.0, paused="true")
        with speaking(command) as log:
            log.wait("INFO", "platform", "paused")
            call("unpause_physics")
            log.wait("WARN", "dropped", "real_time_factor 1000")
            call("pause_physics")
            log.wait("INFO", "no more ticks")
            self.assertLess(len(log.lines("so far")), 3)  # not one a tick

    def test_no_clock_and_a_use_sim_time_that_was_left_behind(self):
        rospy.set_param("/use_sim_time", True)
        with speaking(node_command(scene="pendulum")) as log:
            log.wait("WARN", "/clock", "2 s", "rosparam set /use_sim_time false")
            topic = rospy.Publisher("/clock", Clock, queue_size=1)
            rate = 0

            def come():
                nonlocal rate
                rate += 1
                topic.publish(rospy.Time(100 + 0.01 * rate))
                return log.lines("/clock has come")
            wait_until(come, "the clock's coming")
            self.assertEqual(len(log.lines("nothing on /clock")), 1)

    def test_it_speaks_on_rosout_too(self):
        rosout = Listener("/rosout", Log)
        with running(node_command(paused="true")):
            def is_told():
                call("load_scene", path="winch")  # repeated, since the first may be too early
                return any((m.name, m.level) == (NODE, Log.INFO) and "load_scene winch" in m.msg
                           for m in rosout.messages)
            wait_until(is_told, "a line on /rosout")

    # ---- parameters

    def test_a_parameter_or_scene_that_cannot_be_does_not_block_later_starts(self):
        for wrong in ("_time_step:=-1", "_time_step:=fast", "_scene:=pendulm", "_paused:=7"):
            done = subprocess.run(RUN + [wrong], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  universal_newlines=True, timeout=support.TIMEOUT)
            self.assertEqual(done.returncode, 2, done.stdout)
            if "pendulm" in wrong:
                self.assertIn("did you mean 'pendulum'?", done.stdout)
        with running(RUN):
            self.assertEqual(properties().time_step, 0.01)

    def test_a_wrong_parameter_of_somebody_else_is_told_and_stays(self):
        rospy.set_param(NODE + "/time_step", -1.0)
        done = subprocess.run(RUN, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True, timeout=support.TIMEOUT)
        self.assertEqual(done.returncode, 2)
        self.assertIn("rosparam delete " + NODE + "/time_step", done.stdout)
        self.assertEqual(rospy.get_param(NODE + "/time_step"), -1.0)

    def test_unknown_parameters_and_those_of_an_earlier_run_are_named(self):
        with speaking(RUN + ["_tme_step:=0.1"]) as log:
            log.wait("WARN", "~tme_step", "did you mean 'time_step'?")
        rospy.set_param(NODE + "/scene", "winch")
        rospy.set_param(NODE + "/paused", True)
        with speaking(RUN) as log:
            log.wait("WARN", "~scene 'winch', ~paused true", "earlier run",
                     "rosparam delete " + NODE)


if __name__ == "__main__":
    rospy.init_node("test_log")
    rostest.rosrun("constraint_sim", "log", NodeSpeaks)
