#!/usr/bin/env python3
"""The topic events: changes from one tick to the next, and no tick without a change."""
import math
import unittest

import rospy
import rostest
from constraint_sim.msg import Event

import support
from support import NODE, Listener, call, properties, sphere

TICK = 0.01
FLOOR = "- {name: floor, type: static, shape: {plane: {}}}\n"


class Events(unittest.TestCase):
    def setUp(self):
        support.empty_world()
        self.listener = Listener(NODE + "/events", Event)
        support.wait_until(lambda: NODE + "/events" in support.topics_between(
            NODE, rospy.get_name()), "the connection")

    def tearDown(self):
        call("pause_physics")
        Listener.stop_all()

    def load(self, bodies, constraints="", gravity=9.81):
        answer = call("load_scene", text="world: {gravity: [0, 0, %g]}\nbodies:\n%sconstraints: [%s]\n"
                      % (-gravity, bodies, constraints))
        self.assertTrue(answer.success, answer.status_message)
        self.start = properties().sim_time

    def events(self, *kinds):
        return [e for e in self.listener.messages if e.kind in kinds]

    def wait(self, kind, count=1):
        support.wait_until(lambda: len(self.events(kind)) >= count, "event %d" % kind)
        return self.events(kind)

    def test_a_fall_onto_the_floor_is_one_contact(self):
        self.load(FLOOR + "- {name: ball, mass: 2, shape: {sphere: {radius: 0.1}}, "
                  "position: [0, 0, 0.6]}\n")
        call("step", steps=100)
        event, = self.wait(Event.CONTACT_BEGAN)
        self.assertEqual(set(event.names), {"floor", "ball"})
        falls = math.sqrt(2 * 0.5 / 9.81)
        # at most a tick late: where no finer time is known it is the end of the tick
        self.assertGreater(event.time - self.start, falls - TICK)
        self.assertLess(event.time - self.start, falls + 2 * TICK)
        # impulse that stops 2 kg, plus a tick's weight: within the fall of a tick or two
        self.assertAlmostEqual(event.impulse, 2 * 9.81 * falls, delta=3 * 2 * 9.81 * TICK)
        call("set_body_state", state=self.at("ball", 5.0))
        call("step", steps=2)
        event, = self.wait(Event.CONTACT_ENDED)
        self.assertEqual(set(event.names), {"floor", "ball"})
        self.assertEqual(len(self.listener.messages), 2)

    def at(self, body, z):
        state = call("get_body_state", name=body).state
        state.pose.position.z = z
        return state

    def test_contacts_of_what_is_removed_do_not_end(self):
        self.load(FLOOR + "- {name: ball, mass: 2, shape: {sphere: {radius: 0.1}}, "
                  "position: [0, 0, 0.1]}\n")
        call("step", steps=10)
        self.wait(Event.CONTACT_BEGAN)
        call("remove_body", name="ball")
        call("step", steps=10)
        call("add_body", body=sphere("other", 0, 0, 0.1))
        call("step", steps=10)
        self.wait(Event.CONTACT_BEGAN, 2)  # after all earlier events
        self.assertEqual(self.events(Event.CONTACT_ENDED), [])

    def test_a_rope_gets_taut_and_slack(self):
        self.load("- {name: ball, mass: 2, shape: {point: {}}, position: [0, 0, -0.5]}\n",
                  "{name: line, type: rope, body_b: ball, max_length: 1}")
        call("step", steps=60)
        event = self.wait(Event.ROPE_TAUT)[0]
        self.assertEqual(event.names, ["line"])
        falls = math.sqrt(2 * 0.5 / 9.81)
        self.assertAlmostEqual(event.time - self.start, falls, delta=2 * TICK)
        self.assertAlmostEqual(event.impulse, 2 * 9.81 * falls, delta=3 * 2 * 9.81 * TICK)
        call("set_body_state", state=self.at("ball", -0.5))
        call("step", steps=2)
        self.assertEqual(self.wait(Event.ROPE_SLACK)[-1].names, ["line"])

    def test_what_breaks_says_so_once(self):
        self.load("- {name: ball, mass: 2, shape: {point: {}}, position: [0, 0, -1]}\n",
                  "{name: thread, type: distance, body_b: ball, break_force: 10}")
        call("step", steps=50)
        event, = self.wait(Event.BROKEN)
        self.assertEqual(event.names, ["thread"])
        self.assertEqual(len(self.listener.messages), 1)

    def test_a_motor_reaches_its_limit_and_leaves_it(self):
        self.load("- {name: ball, mass: 2, shape: {point: {}}, position: [0, 0, -1]}\n",
                  "{name: winch, type: distance, body_b: ball, motor: {bias: -0.1, max_force: 5}}")
        call("step", steps=20)
        self.assertEqual(self.wait(Event.SATURATED)[0].names, ["winch"])
        call("set_motor_bias", constraint="winch", bias=-0.1, max_force=500)
        call("step", steps=100)  # the winch catches the ball, and then winds it up
        self.assertEqual(self.wait(Event.RELEASED)[-1].names, ["winch"])

    def at_moments(self, events, *moments):
        """Event-driven islands have event times within the tick."""
        for event, moment in zip(events, moments):
            self.assertAlmostEqual(event.time - self.start, moment, delta=1e-9)

    def test_a_limit_is_reached_and_left_at_its_moments(self):
        self.load("- {name: ball, mass: 2, shape: {sphere: {radius: 0.1}}, position: [0, 0, 0.5]}\n",
                  "{name: stop, type: slider, axis_a: [0, 0, 1], body_b: ball, lower: 0, "
                  "limit_restitution: 0.5}")
        call("step", steps=70)
        reached = self.wait(Event.LIMIT_REACHED, 2)
        left = self.wait(Event.LIMIT_LEFT, 1)
        self.assertEqual(reached[0].names, ["stop"])
        self.assertEqual(left[0].names, ["stop"])
        falls = math.sqrt(2 * 0.5 / 9.81)
        self.at_moments(reached, falls, 2 * falls)
        self.at_moments(left, falls)
        self.assertAlmostEqual(reached[0].impulse, 1.5 * 2 * 9.81 * falls, delta=1e-8)

    def test_a_box_that_slides_sticks(self):
        self.load("- {name: floor, type: static, shape: {plane: {}}, friction: 0.3}\n"
                  "- {name: box, mass: 2, shape: {box: {size: [0.6, 0.5, 0.4]}}, friction: 0.3, "
                  "position: [0, 0, 0.2], linear_velocity: [1, 0, 0]}\n")
        call("step", steps=50)
        event, = self.wait(Event.STICKS)
        self.assertEqual(set(event.names), {"floor", "box"})
        self.at_moments([event], 1 / (0.3 * 9.81))

    def test_what_friction_holds_slips(self):
        # a spring with a moving end pulls with more than friction holds, f = k v t
        self.load("- {name: drawn, mass: 1.5, shape: {sphere: {radius: 0.1}}}\n"
                  "- {name: end, type: kinematic, shape: {point: {}}, position: [0, 0, 1], "
                  "linear_velocity: [0, 0, 0.25]}\n",
                  "{name: rail, type: slider, axis_a: [0, 0, 1], body_b: drawn, friction: 20}, "
                  "{name: coil, type: spring, body_a: drawn, body_b: end, length: 1, stiffness: 300}",
                  gravity=0)
        call("step", steps=40)
        event = self.wait(Event.SLIPS)[0]
        self.assertEqual(event.names, ["rail"])
        self.at_moments([event], 20 / (300 * 0.25))

    def test_a_hit_in_a_contact_is_told(self):
        # three balls on a line; the second and the third touch from the start
        self.load("".join(
            "- {name: %s, mass: 1, shape: {sphere: {radius: 0.1}}, restitution: 0.5, "
            "position: [%g, 0, 0], linear_velocity: [%g, 0, 0]}\n" % ball
            for ball in (("first", -0.5, 3), ("second", 0, 0), ("third", 0.2, 0))), gravity=0)
        call("step", steps=20)
        hit = self.wait(Event.HIT)[0]
        began, = (e for e in self.events(Event.CONTACT_BEGAN) if "first" in e.names)
        self.assertEqual(set(began.names), {"first", "second"})
        self.assertEqual(set(hit.names), {"second", "third"})
        self.at_moments([began, hit], 0.1, 0.1)
        # each gets 3/4 of the speed of the previous one and leaves it 1/4, so the first hits the second again
        # with 3/4 - 3/4 * 3/4 of it
        self.assertAlmostEqual(began.impulse, 3 * 0.75 + 0.75 * 3 * (0.25 - 0.75 * 0.25), delta=1e-9)
        self.assertAlmostEqual(hit.impulse, 3 * 0.75 ** 2, delta=1e-9)

    def test_contacts_go_to_impulses_and_come_back(self):
        # six balls lie in a row; three more fly past: nine that may touch
        ball = ("- {name: %s, mass: 1, shape: {sphere: {radius: 0.1}}, friction: 0.5, "
                "position: [%.4f, %g, %g], linear_velocity: [0, %g, 0]}\n")
        self.load(FLOOR + "".join(
            [ball % ("lies_%d" % i, 0.2001 * i, 0, 0.1, 0) for i in range(6)] +
            [ball % ("flies_%d" % i, 0.4 * i, -3, 0.45, 10) for i in range(3)]))
        call("step", steps=300)
        gone = self.wait(Event.HANDED_OVER, 6)
        back = self.wait(Event.TAKEN_BACK, 6)
        lie = {"lies_%d" % i for i in range(6)}
        for events in (gone, back):
            self.assertTrue(all(len(event.names) == 1 for event in events))
            self.assertLessEqual(lie, {event.names[0] for event in events})
        first = {name: min(e.time for e in gone if e.names == [name]) for name in lie}
        for name in lie:  # at least half a second
            self.assertGreater(min(e.time for e in back if e.names == [name]), first[name] + 0.49)

    def test_a_failure_names_the_body(self):
        body = sphere("fast", 1e20)
        body.twist.linear.x = 1e20
        call("add_body", body=body)
        call("unpause_physics")
        event, = self.wait(Event.FAILED)
        self.assertEqual(event.names, ["fast"])

    def test_the_stamp_and_frame_are_those_of_other_topics(self):
        self.test_what_breaks_says_so_once()
        header = self.listener.messages[0].header
        self.assertEqual(header.frame_id, "world")
        self.assertLess(abs((rospy.Time.now() - header.stamp).to_sec()), 60.0)


if __name__ == "__main__":
    rospy.init_node("test_events")
    rostest.rosrun("constraint_sim", "events", Events)
