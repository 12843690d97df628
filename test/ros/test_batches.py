#!/usr/bin/env python3
"""Many edits in one call: all in one tick, or none."""
import unittest

import rospy
import rostest
from constraint_sim.msg import BodyState, Constraint, MotorBias
from constraint_sim.srv import ApplyEditsRequest

import support
from support import call, properties, sphere


def rod(name, body_a, body_b, **fields):
    return Constraint(name=name, type="distance", body_a=body_a, body_b=body_b, **fields)


def chain(links):
    """Returns balls in a row, each on a rod to the previous one."""
    balls = [sphere("ball_%d" % i, x=i, no_collision=True) for i in range(links)]
    rods = [rod("rod_%d" % i, "ball_%d" % (i - 1) if i else "world", "ball_%d" % i,
                length=1.0 if i else 0.5) for i in range(links)]
    return balls, rods


class Batches(unittest.TestCase):
    def setUp(self):
        support.empty_world()

    def bad(self, named, **fields):
        before = properties()
        answer = call("apply_edits", **fields)
        self.assertFalse(answer.success)
        for word in named:
            self.assertIn(word, answer.status_message)
        self.assertEqual((answer.removed_constraints, list(answer.initial_errors)), ([], []))
        after = properties()
        self.assertEqual(after.state_hash, before.state_hash)
        self.assertEqual(after.bodies, before.bodies)

    def test_a_thousand_edits_take_one_tick(self):
        balls, rods = chain(500)
        call("unpause_physics")
        answer = call("apply_edits", bodies=balls, constraints=rods)
        self.assertTrue(answer.success, answer.status_message)
        call("pause_physics")
        now = properties()
        self.assertEqual((len(now.bodies), len(now.constraints)), (500, 500))
        self.assertGreaterEqual(now.step, answer.step)
        # the first one is 0.5 m short: it hangs at the origin itself
        self.assertEqual(answer.initial_errors[0], -0.5)
        self.assertEqual(set(answer.initial_errors[1:]), {0.0})
        self.assertIn("rod_0", answer.status_message)

    def hash_after(self, edit):
        """Returns the hash of a new world, 100 steps after an edit at time 0."""
        self.assertTrue(call("load_scene", text="bodies: []").success)
        call("reset_simulation")
        edit()
        return call("step", steps=100).state_hash

    def test_it_does_what_the_single_services_do(self):
        balls, rods = chain(3)
        motor = MotorBias(constraint="rod_1", bias=0.1, max_force=0.0, timeout=2.0)
        state = BodyState(name="ball_2", pose=balls[2].pose)
        state.twist.linear.y = 0.3

        def one_by_one():
            for ball in balls:
                self.assertTrue(call("add_body", body=ball).success)
            for one in rods:
                self.assertTrue(call("add_constraint", constraint=one).success)
            self.assertTrue(call("set_body_state", state=state).success)
            self.assertTrue(call("set_motor_bias", constraint="rod_1", bias=0.1,
                                 timeout=2.0).success)

        def at_once():
            answer = call("apply_edits", bodies=balls, constraints=rods, states=[state],
                          motors=[motor])
            self.assertTrue(answer.success, answer.status_message)

        self.assertEqual(self.hash_after(at_once), self.hash_after(one_by_one))

    def test_removals_come_first(self):
        balls, rods = chain(3)
        self.assertTrue(call("apply_edits", bodies=balls, constraints=rods).success)
        answer = call("apply_edits", bodies=[balls[1]], constraints=[rods[1]],
                      remove_bodies=["ball_1"], remove_constraints=["rod_2"])
        self.assertTrue(answer.success, answer.status_message)
        self.assertEqual(answer.removed_constraints, ["rod_1"])
        now = properties()
        self.assertEqual(sorted(now.bodies), ["ball_0", "ball_1", "ball_2"])
        self.assertEqual(sorted(now.constraints), ["rod_0", "rod_1"])

    def test_one_bad_element_of_a_thousand_changes_nothing(self):
        balls, rods = chain(500)
        self.assertTrue(call("apply_edits", bodies=[sphere("first")]).success)
        self.bad(["bodies[499]", "mass", "-1"],
                 bodies=balls[:-1] + [sphere("bad", mass=-1.0)], constraints=rods[:-1])
        self.bad(["constraints[500]", "body_b", "nobody"], bodies=balls,
                 constraints=rods + [rod("bad", "ball_0", "nobody")])
        self.bad(["remove_bodies[1]", "name"], remove_bodies=["first", "first"])
        self.bad(["remove_constraints[0]", "name"], remove_constraints=["rod"])
        state = BodyState(name="first")
        state.twist.linear.x = float("nan")
        self.bad(["states[1]", "linear_velocity", "nan"],
                 states=[BodyState(name="first"), state])
        self.bad(["motors[0]", "constraint"], bodies=balls,
                 motors=[MotorBias(constraint="rod_1")])

    def test_nothing_is_an_edit_of_nothing(self):
        before = properties().state_hash
        self.assertTrue(call("apply_edits").success)
        self.assertEqual(properties().state_hash, before)
        self.assertEqual(set(ApplyEditsRequest.__slots__),
                         {"bodies", "constraints", "remove_bodies", "remove_constraints",
                          "states", "motors"})


if __name__ == "__main__":
    rospy.init_node("test_batches")
    rostest.rosrun("constraint_sim", "batches", Batches)
