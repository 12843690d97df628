#!/usr/bin/env python3
"""rviz on a virtual display, with a real mouse: bodies are dragged, clicked and chosen from a menu."""
import math
import re
import shutil
import subprocess
import time

import rospy
import rostest
from constraint_sim.msg import Statistics
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import InteractiveMarkerFeedback

import support
from in_rviz import HEIGHT, START, WIDTH, InRviz, shipped_configuration
from support import NODE, Listener, call, properties

SCALE = 100.0  # pixels a metre, seen from above
VIEW = """  Views:
    Current:
      Class: rviz/TopDownOrtho
      Name: Current View
      Target Frame: <Fixed Frame>
      Scale: %g
      X: 0
      Y: 0
      Angle: 0
""" % SCALE


def from_above():
    """Returns the shipped configuration of rviz, seen straight from above: pixels are metres. Without
    labels: the legend would hide a single body."""
    text = shipped_configuration()
    text, count = re.subn(r"  Views:\n(?:    .*\n)+", VIEW, text)
    assert count == 1 and "/labels" in text
    return text.replace("/constraint_sim/labels", "/constraint_sim/no_labels")


class Patience:
    """Time for rviz to draw the element under the pointer, without a notification. Longer in each trial, so
    that a trial succeeds on a machine of any load."""

    def __init__(self, seconds):
        self.seconds = seconds

    def wait(self, count=1):
        time.sleep(count * self.seconds)

    def grow(self):
        self.seconds *= 1.5


class Mouse(InRviz):
    configuration = staticmethod(from_above)

    def setUp(self):
        support.empty_world()
        self.feedback = Listener(NODE + "/hands/feedback", InteractiveMarkerFeedback)

    def tearDown(self):
        self.mouse("mouseup", "1")
        call("pause_physics")
        Listener.stop_all()

    def mouse(self, *arguments):
        subprocess.check_call(["xdotool", *map(str, arguments)], env=self.environment)

    def point(self, x, y):
        """Moves the pointer to a place [m]: x is to the right, y up, from the middle of the view."""
        self.mouse("mousemove", round(self.centre[0] + SCALE * x), round(self.centre[1] - SCALE * y))

    def load(self, text):
        answer = call("load_scene", text=text)
        self.assertTrue(answer.success, answer.status_message)
        call("unpause_physics")

    # found by the first scene: window decorations differ
    centre = (WIDTH / 2, HEIGHT / 2 + 16)

    def grab(self, body, x, y):
        """Presses the button over the body, repeatedly until rviz has it under the pointer."""
        patience = Patience(0.1)

        def pressed():
            self.has_restarted()
            self.mouse("mouseup", "1")
            self.point(x, y)
            patience.wait()
            self.point(x + 0.02, y)  # rviz finds the element under the pointer when the pointer moves
            patience.wait()
            self.mouse("mousedown", "1")
            patience.wait()
            patience.grow()
            return any(m.event_type == InteractiveMarkerFeedback.MOUSE_DOWN and
                       m.marker_name == body for m in self.feedback.messages)
        try:
            support.wait_until(pressed, body + " under the pointer", START)
        except AssertionError:  # shows the view and the place
            self.screenshot("grab_%s.png" % body)
            print(call("get_body_state", name=body).state)
            raise

    def x(self, body):
        return call("get_body_state", name=body).state.pose.position.x

    def speed(self, body):
        return abs(call("get_body_state", name=body).state.twist.linear.x)

    def is_held(self):
        return any(name.startswith("hand/") for name in properties().constraints)

    def drag_two_metres(self, body, start):
        self.grab(body, start, 0)
        for step in range(1, 51):
            self.point(start + 0.02 + 0.04 * step, 0)
            time.sleep(0.04)  # a metre a second, on which the bounds depend
        self.screenshot("drag_%s.png" % body)
        # the button stays down, the pointer still: rviz repeats its feedback four times a second
        support.wait_until(lambda: abs(self.x(body) - start - 2.0) < 0.05, "two metres")
        self.assertTrue(self.is_held())

    def let_go(self):
        self.mouse("mouseup", "1")
        support.wait_until(lambda: not self.is_held(), "the release")

    def weightless(self, bodies, constraints="  []\n"):
        return ("world: {gravity: [0, 0, 0]}\nbodies:\n%sconstraints:\n%s" % (bodies, constraints))

    def ball(self, name, mass, x, y=0):
        return ("- {name: %s, mass: %g, no_collision: true, shape: {sphere: {radius: 0.2}}, "
                "position: [%g, %g, 0]}\n" % (name, mass, x, y))

    def test_a_speck_and_a_thousand_tonnes_are_dragged_two_metres(self):
        for mass, name in ((1e-3, "speck"), (1e6, "rock")):
            self.load(self.weightless(self.ball(name, mass, -2)))
            self.drag_two_metres(name, -2)
            support.wait_until(lambda: self.speed(name) < 1e-3, "rest")
            self.let_go()
            self.assertLess(self.speed(name), 2e-3)

    def test_a_load_is_dragged_through_a_chain(self):
        bodies = self.ball("rock", 1e6, -3) + "".join(
            self.ball("bead%d" % i, 1e-3, -3 + 0.5 * i) for i in range(1, 4))
        names = ["rock", "bead1", "bead2", "bead3"]
        rods = "".join("- {name: r%d, type: distance, body_a: %s, body_b: %s}\n" % (i, a, b)
                       for i, (a, b) in enumerate(zip(names, names[1:])))
        self.load(self.weightless(bodies, rods))
        self.drag_two_metres("bead3", -1.5)
        # the rock follows; a chain pulls and cannot push, so the rock may pass the beads and be pulled back
        support.wait_until(lambda: self.x("rock") > -1.0 - 0.05, "two metres of the rock's way")
        call("set_options", keys=["real_time_factor"], values=["10"])
        # at rest by energy, including the springs: the rock is also slow where it reverses
        statistics = Listener(NODE + "/statistics", Statistics)
        start = properties().step

        def at_rest():
            now = properties().step
            second = [m.energy for m in statistics.messages if m.step > max(start, now - 1000)]
            return now > start + 1000 and max(second, default=math.inf) < 0.5 * 0.5e6 * 1e-3
        support.wait_until(at_rest, "the rock at rest")
        self.let_go()
        call("set_options", keys=["real_time_factor"], values=["1"])
        released = properties().step
        first = statistics.wait(lambda m: m.ticks > 0 and m.step > released)
        later = statistics.wait(lambda m: m.step > first.step + 200)
        # at most a thousandth of the energy at 1 m/s remains, 0.02 m/s, and 2e-2 m/s of the beads; it is not
        # driven any more, within the tolerance of 2 s
        self.assertLess(first.energy, 0.5e6 * 1e-3)
        self.assertLessEqual(later.energy, first.energy * (1 + 1e-6))

    def test_a_viewer_that_dies_in_a_drag_lets_go(self):
        self.load(self.weightless(self.ball("ball", 1, 0)))
        self.grab("ball", 0, 0)
        self.point(0.5, 0)
        support.wait_until(self.is_held, "the grip")
        self.rviz.send_signal(19)  # SIGSTOP: feedback ends; test_hands tests the time
        try:
            support.wait_until(lambda: not self.is_held(), "the release")
        finally:
            self.rviz.send_signal(18)

    MENU = ("Fix here", "Release", "Remove", "Push along +x", "Push along -x", "Push along +y", "Push along -y",
            "Push along +z", "Push along -z", "Join: mark this body", "Join to the marked body", "Follow")

    def choose(self, title, x, y, is_done):
        """Opens the menu of the body at this place, and selects the entry; repeats where the menu was late."""
        patience = Patience(0.2)

        def chosen():
            self.point(x, y)
            patience.wait()
            self.point(x + 0.02, y)
            patience.wait()
            self.mouse("click", "3")
            patience.wait(2)
            self.screenshot("menu.png")
            for _ in range(self.MENU.index(title) + 1):
                self.mouse("key", "Down")
            self.mouse("key", "Return")
            for _ in range(10):
                if is_done():
                    return True
                patience.wait()
            self.mouse("key", "Escape")
            patience.grow()
            return False
        support.wait_until(chosen, title, START)

    def test_the_menu_does_what_it_says(self):
        self.load(self.weightless(self.ball("ball", 1, 0) + self.ball("other", 1, -1.5)))
        self.grab("ball", 0, 0)
        self.mouse("mouseup", "1")
        constraints = lambda: properties().constraints
        self.choose("Fix here", 0, 0, lambda: "fixed/ball" in constraints())
        self.choose("Release", 0, 0, lambda: "fixed/ball" not in constraints())
        taken = lambda: any(m.event_type == InteractiveMarkerFeedback.MENU_SELECT and
                            m.marker_name == "ball" for m in self.feedback.messages[known:])
        known = len(self.feedback.messages)
        self.choose("Join: mark this body", 0, 0, taken)
        self.choose("Join to the marked body", -1.5, 0, lambda: "joined/ball/other" in constraints())
        followed = Listener("/tf", TFMessage)
        self.choose("Follow", 0, 0, lambda: any(
            t.child_frame_id == "followed" for m in followed.messages for t in m.transforms))
        self.choose("Remove", -1.5, 0, lambda: properties().bodies == ["ball"])
        # the body moves with each repeated push: one push is needed
        self.choose("Push along +y", 0, 0, lambda: call(
            "get_body_state", name="ball").state.twist.linear.y > 0.99)


if __name__ == "__main__":
    rospy.init_node("test_mouse")
    if not shutil.which("xdotool"):
        raise SystemExit("xdotool is needed: scripts/setup")
    rostest.rosrun("constraint_sim", "mouse", Mouse)
