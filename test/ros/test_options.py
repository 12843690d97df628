#!/usr/bin/env python3
"""Options and settings of bodies, changed while the world runs."""
import math
import time

import rospy
import rostest
import yaml
from constraint_sim.msg import Body, BodyStates, Shape
from geometry_msgs.msg import Point, Pose, Vector3, Wrench

import support
from support import call, properties, sphere


def state_of(name):
    return call("get_body_state", name=name).state


class Options(support.ServiceCase):
    def setUp(self):
        call("set_options", keys=["real_time_factor", "publish_rate"], values=["1", "50"])
        support.empty_world()
        call("reset_simulation")

    def test_gravity_while_a_ball_falls(self):
        self.good("add_body", body=sphere("ball", z=100.0))
        call("step", steps=100)
        self.good("set_options", keys=["gravity", "tolerance"], values=["[0, 0, -1.62]", "1e-10"])
        self.assertEqual(properties().gravity.z, -1.62)
        call("step", steps=100)
        state = state_of("ball")
        # successive parabolas; rounding of 200 sums of 100 m
        self.assertAlmostEqual(state.pose.position.z, 100 - 4.905 - 9.81 - 0.81, delta=1e-11)
        self.assertAlmostEqual(state.twist.linear.z, -9.81 - 1.62, delta=1e-12)

    def test_every_option_of_scenes(self):
        saved = yaml.safe_load(call("save_scene").text)["world"]
        saved.pop("clock", None)
        text = {True: "true", False: "false"}
        values = [text[v] if isinstance(v, bool) else str(v).replace("inf", ".inf")
                  for v in saved.values()]
        self.assertGreater(len(saved), 10)
        before = properties().state_hash
        self.good("set_options", keys=list(saved), values=values)
        self.assertEqual(properties().state_hash, before)  # all options are unchanged
        for key, value in (("method", "energy_momentum"), ("order", "5"), ("time_step", "0.02"),
                           ("warm_starting", "false"), ("sleep_after", ".inf")):
            self.good("set_options", keys=[key], values=[value])
            self.assertEqual(yaml.safe_load(call("save_scene").text)["world"][key],
                             yaml.safe_load(value))

    def test_what_cannot_be_changes_nothing(self):
        self.bad(["gravity", "1"], "set_options", keys=["gravity"], values=["1"])
        self.bad(["tolerance", "-1"], "set_options", keys=["order", "tolerance"],
                 values=["5", "-1"])
        self.bad(["gravty", "gravity"], "set_options", keys=["gravty"], values=["[0, 0, 0]"])
        self.bad(["twice"], "set_options", keys=["order", "order"], values=["5", "8"])
        self.bad(["values", "1", "2"], "set_options", keys=["order", "tolerance"], values=["5"])
        self.bad(["clock"], "set_options", keys=["clock"], values=["{}"])
        for text in ("", "{}", "5\norder: 8", "5 # or 8", "&a 5", "'5'"):
            self.bad(["order"], "set_options", keys=["order"], values=[text])
        for text in ("nan", "-1", "fast", "1e7", "1 2"):
            self.bad(["real_time_factor"], "set_options", keys=["order", "real_time_factor"],
                     values=["5", text])
        for text in ("0", "inf", "1e5", ""):
            self.bad(["publish_rate"], "set_options", keys=["publish_rate"], values=[text])

    def test_the_real_time_factor(self):
        self.good("add_body", body=sphere("ball", z=100.0))
        self.good("set_options", keys=["real_time_factor"], values=["0.1"])
        call("unpause_physics")
        begun = time.monotonic()  # before and after the measured interval
        start = properties().sim_time
        passed = support.wait_until(lambda: max(properties().sim_time - start - 0.1, 0.0), "0.1 s") + 0.1
        # as slow as requested, never faster; a loaded machine may be slower
        self.assertLessEqual(passed, 0.1 * (time.monotonic() - begun) + 0.05)
        self.good("set_options", keys=["real_time_factor"], values=["0"])
        support.wait_until(lambda: properties().sim_time > start + 20.0, "20 s at full speed")

    def test_the_publish_rate(self):
        self.good("add_body", body=sphere("ball", z=100.0))
        states = support.Listener("/constraint_sim/body_states", BodyStates)
        call("unpause_physics")
        for rate in (5.0, 40.0, 5.0):
            self.good("set_options", keys=["publish_rate"], values=[str(rate)])
            start = len(states.messages)

            def is_kept():
                """Returns whether eleven messages in a row have the rate, by their stamps; also a busy
                machine reaches it at some time."""
                stamps = [m.header.stamp.to_sec() for m in states.messages[start:]]
                return any(0.8 < (b - a) * rate / 10 < 1.2 for a, b in zip(stamps, stamps[10:]))
            support.wait_until(is_kept, "%g messages a second" % rate)
        support.Listener.stop_all()

    # ---- bodies

    def test_the_mass_of_a_falling_ball_that_is_pushed(self):
        self.good("set_options", keys=["gravity"], values=["[0, 0, 0]"])
        self.good("add_body", body=sphere("ball"))
        call("apply_body_wrench", body_name="ball", wrench=Wrench(force=Vector3(6, 0, 0)),
             duration=rospy.Duration(-1))
        call("step", steps=100)
        self.good("set_body_properties", name="ball", keys=["mass"], values=[3.0])
        call("step", steps=100)
        self.assertAlmostEqual(state_of("ball").twist.linear.x, 6.0 + 2.0, delta=1e-12)

    def test_the_share_of_weight_that_nothing_carries(self):
        """0.25 of the weight is taken off in the message, and all of it in flight: v = 0.75 g, then constant."""
        self.good("set_options", keys=["gravity"], values=["[0, 0, -10]"])
        self.good("add_body", body=sphere("ball", gravity_compensation=0.25))
        call("step", steps=100)
        self.good("set_body_properties", name="ball", keys=["gravity_compensation"], values=[1.0])
        call("step", steps=100)
        self.assertAlmostEqual(state_of("ball").twist.linear.z, -7.5, delta=1e-12)

    def test_groups_of_bodies_that_collide(self):
        """A ball lies on a floor of group 2; without that group in its mask it falls."""
        self.good("set_options", keys=["gravity"], values=["[0, 0, -10]"])
        self.good("add_body", body=Body(name="floor", type=Body.STATIC, shapes=[Shape(type=Shape.PLANE)],
                                        collision_groups=4))
        self.good("add_body", body=sphere("ball", pose=Pose(position=Point(0, 0, 0.1))))
        call("step", steps=100)
        self.assertAlmostEqual(state_of("ball").pose.position.z, 0.1, delta=1e-9)
        self.good("set_body_properties", name="ball", keys=["collision_mask"], values=[float(2**32 - 5)])
        call("step", steps=100)
        self.assertAlmostEqual(state_of("ball").twist.linear.z, -10.0, delta=1e-9)

    def test_settings_of_bodies_that_cannot_be(self):
        self.good("add_body", body=sphere("ball"))
        for key, value in (("mass", 0.0), ("mass", math.nan), ("inertia_x", 1.0),
                           ("friction", -1.0), ("restitution", 2.0), ("no_collision", 0.5),
                           ("gravity_compensation", 1.5), ("collision_groups", 0.0), ("collision_mask", 2.5),
                           ("collision_mask", 2.0**32)):
            self.bad([key.split("_x")[0]], "set_body_properties", name="ball", keys=[key],
                     values=[value])
        self.bad(["colour"], "set_body_properties", name="ball", keys=["colour"], values=[1.0])
        self.bad(["name", "nobody"], "set_body_properties", name="nobody", keys=["mass"],
                 values=[1.0])
        self.bad(["values"], "set_body_properties", name="ball", keys=["mass"], values=[])
        self.good("set_body_properties", name="ball",
                  keys=["inertia_x", "inertia_y", "inertia_z", "friction", "restitution"],
                  values=[1.0, 2.0, 2.5, 0.3, 0.4])
        text = call("save_scene").text
        for word in ("inertia: [1, 2, 2.5]", "friction: 0.3", "restitution: 0.4"):
            self.assertIn(word, text)

    # ---- scenes

    def test_the_list_of_scenes(self):
        answer = self.good("list_scenes")
        self.assertIn("pendulum", answer.scenes)
        self.assertEqual(list(answer.scenes), sorted(answer.scenes))
        self.assertEqual(len(answer.scenes), len(answer.descriptions))
        self.assertIn("rigid rod", answer.descriptions[answer.scenes.index("pendulum")])
        for scene, description in zip(answer.scenes, answer.descriptions):
            self.assertTrue(description, scene)
            self.good("load_scene", path=scene)


if __name__ == "__main__":
    rospy.init_node("test_options")
    rostest.rosrun("constraint_sim", "options", Options)
