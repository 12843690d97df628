#!/usr/bin/env python3
"""The service `verify`: copies of the live world, while other calls are served."""
import math
import threading
import time

import rospy
import rostest

import support
from support import call, properties, wait_until

CHAIN = """
world: {time_step: 0.001}
bodies:
%s
constraints:
%s""" % ("\n".join("- {name: link_%d, mass: 1, position: [%g, 0, 0]}" % (i, 0.1 * (i + 1))
                   for i in range(30)),
         "\n".join("- {name: rod_%d, body_a: %s, body_b: link_%d}" %
                   (i, "link_%d" % (i - 1) if i else "world", i) for i in range(30)))


class Verify(support.ServiceCase):
    def setUp(self):
        support.empty_world()

    def test_a_pendulum_holds_and_the_world_stays(self):
        self.good("load_scene", path="pendulum")
        self.good("step", steps=50)
        before = properties()
        verified = self.good("verify", steps=100)
        after = properties()
        self.assertEqual((after.step, after.state_hash), (before.step, before.state_hash))
        self.assertEqual(verified.steps, 100)
        self.assertEqual(verified.time_step, before.time_step)
        self.assertEqual((verified.method, verified.other_method), ("auto", "energy_momentum"))
        self.assertEqual((verified.bodies, verified.verdicts), (["bob"], ["holds"]))
        self.assertFalse(verified.exceeds)
        self.assertLess(verified.half_step_differences[0], 1e-9)
        self.assertEqual(verified.global_errors[0], verified.estimates[0] * verified.growths[0])
        self.assertIn("holds", verified.table)

    def test_impulses_at_a_long_tick_exceed(self):
        self.good("load_scene", text="""
world: {time_step: 0.1, method: sequential_impulses}
bodies: [{name: bob, mass: 1, position: [1, 0, 0]}]
constraints: [{name: rod, body_b: bob}]""")
        verified = self.good("verify", steps=10)
        self.assertTrue(verified.exceeds)
        self.assertEqual(verified.verdicts, ["exceeds"])
        self.assertTrue(math.isnan(verified.estimates[0]))
        self.assertIn("sequential_impulses has no estimate", verified.left_out[0])

    def test_bad_input(self):
        self.bad(["steps", "100000", "100001"], "verify", steps=100001)
        self.bad(["steps", "no verification"], "verify", steps=0)

    def test_others_are_served_meanwhile_and_it_can_be_cancelled(self):
        self.good("load_scene", text=CHAIN)
        answers = []

        def verify():
            answer = call("verify", steps=100000)
            while "a verification runs" in answer.status_message:  # the verification of the loop below
                answer = call("verify", steps=100000)
            answers.append(answer)

        verifying = threading.Thread(target=verify)
        verifying.start()
        # the second caller is rejected as soon as the first one runs
        wait_until(lambda: "a verification runs" in call("verify", steps=1).status_message,
                   "a verification that runs")
        begun = time.monotonic()
        step = properties().step
        self.good("step", steps=5)
        self.assertEqual(properties().step, step + 5)
        self.good("set_options", keys=["tolerance"], values=["1e-7"])
        self.assertLess(time.monotonic() - begun, support.TIMEOUT)
        self.assertEqual(answers, [])
        self.good("verify", steps=0)
        verifying.join(support.TIMEOUT)
        self.assertFalse(answers[0].success)
        self.assertIn("cancelled", answers[0].status_message)
        self.good("verify", steps=1)


if __name__ == "__main__":
    rospy.init_node("test_verify")
    rostest.rosrun("constraint_sim", "verify", Verify)
