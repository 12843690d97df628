#!/usr/bin/env python3
"""Joints with coordinates by service: laws, motors, joint_states, errors of open joints."""
import math

import rospy
import rostest
from constraint_sim.msg import Body, Constraint, ConstraintStates, CoordinateLaw, Motor, Shape
from constraint_sim_client import messages
from geometry_msgs.msg import Point, Vector3, WrenchStamped
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

import support
from support import Listener, call, properties

MASS, LENGTH, WIDTH = 2.0, 1.0, 0.1
# moment of a bar about its end
INERTIA = MASS * (LENGTH ** 2 + WIDTH ** 2) / 12.0 + MASS * (0.5 * LENGTH) ** 2

# bar held at its end by a ball joint
HANGING = """
world: {gravity: [0, -9.81, 0], time_step: 0.01, method: auto}
bodies:
  - {name: bar, mass: 2, shape: {box: {size: [1, 0.1, 0.1]}}, position: [0.5, 0, 0]}
constraints:
  - {name: j, type: ball, body_b: bar, anchor_b: [-0.5, 0, 0]}
"""


class Joints(support.ServiceCase):
    def setUp(self):
        support.empty_world()
        self.good("load_scene",
                  text="world: {gravity: [0, 0, 0], time_step: 0.01, method: auto}")
        bar = Body(name="bar", mass=MASS,
                   shapes=[Shape(type=Shape.BOX, dimensions=[LENGTH, WIDTH, WIDTH])])
        bar.pose.position.x = 0.5 * LENGTH
        self.good("add_body", body=bar)
        self.listener = Listener(support.NODE + "/joint_states", JointState)

    def tearDown(self):
        Listener.stop_all()

    def joint(self, kind="hinge", laws=(), **fields):
        message = messages.constraint("j", kind, body_b="bar", anchor_b=(-0.5 * LENGTH, 0, 0), **dict(laws))
        for field, value in fields.items():
            setattr(message, field, value)
        return message

    def states(self):
        """Returns position, velocity and effort by name, as last published: they are repeated while
        paused."""
        if not self.listener.messages:
            return {}
        message = self.listener.messages[-1]
        return {name: values for name, *values in
                zip(message.name, message.position, message.velocity, message.effort)}

    def reaches(self, expected, tolerances):
        """Waits until all published values are near the expected ones: a message of an earlier tick may
        arrive after the response of `step`."""
        def near():
            states = self.states()
            return list(states) == list(expected) and all(
                abs(f - e) <= t for name in expected
                for f, e, t in zip(states[name], expected[name], tolerances))
        support.wait_until(near, "%s, not %s" % (expected, self.states()))

    def test_a_spring_swings_a_hinge_between_its_limits(self):
        stiffness = INERTIA * math.pi ** 2  # half a period of 1 s
        self.good("add_constraint", constraint=self.joint(
            laws={"stiffness": stiffness, "rest": 0.2, "lower": -2.0, "upper": 2.0}))
        self.good("step", steps=100)
        # from 0 about 0.2 and back: after half a period at 0.4, at rest; unreached limits change nothing
        self.reaches({"j": (0.4, 0.0, 0.0)}, (1e-6, 1e-5, 0.0))  # no actuator, no effort
        # the spring pulls with 0.2 rad there; the force is the mean over a tick
        states = Listener(support.NODE + "/constraint_states", ConstraintStates).wait()
        self.assertAlmostEqual(states.constraints[0].force, -stiffness * 0.2, delta=1e-3 * stiffness * 0.2)
        text = self.good("save_scene").text
        for line in ("lower: -2", "upper: 2", "rest: 0.2"):
            self.assertIn(line, text)

    def test_set_motor_bias_turns_a_hinge_and_moves_a_slider(self):
        for kind in ("hinge", "slider"):
            self.good("add_constraint", constraint=self.joint(
                kind, laws={"stiffness": 5.0, "lower": -2.0, "upper": 2.0}))
            self.good("set_motor_bias", constraint="j", bias=0.25, timeout=0.8)
            listener = Listener(support.NODE + "/constraint_states", ConstraintStates)
            self.good("step", steps=40)
            state = listener.present().constraints[0]
            self.assertEqual((state.type, state.bias), (kind, 0.25))
            # within the residual of ten warm-started sweeps
            self.assertAlmostEqual(state.reached_rate, 0.25, places=6)
            # the motor works against the spring of 5 N m/rad, whose force is in `force` as well
            support.wait_until(lambda: abs(listener.messages[-1].constraints[0].force -
                                           (self.states()["j"][2] - 5.0 * 0.25 * 0.395)) < 1e-9,
                               "the effort to be the motor's")
            self.good("step", steps=160)
            # 0.8 s of 0.25 a second, then held against the spring, except for the motor's part in closing
            # the anchors, a few N when it stops, and 0.9 of that with each of 120 steps
            self.reaches({"j": (0.2, 0.0, 5.0 * 0.2)}, (1e-9, 1e-9, 1e-2))
            self.good("remove_constraint", name="j")

    def test_further_coordinates_have_numbers(self):
        self.good("add_constraint", constraint=self.joint(
            "cylindrical", {"coordinates": [{"motor": {}}, {"motor": {"bias": 0.5}}]},
            anchor_a=Point(0.5 * LENGTH, 0, 0), anchor_b=Point()))
        self.good("step", steps=100)
        # runge_kutta holds motors to rounding
        self.reaches({"j": (0.0, 0.0, 0.0), "j/1": (0.5, 0.5, 0.0)}, 3 * [1e-9])

    def test_a_gear_turns_a_second_wheel(self):
        wheel = Body(name="wheel", mass=1.0,
                     shapes=[Shape(type=Shape.BOX, dimensions=[0.2, 0.2, 0.1])])
        wheel.pose.position.y = 2.0
        self.good("add_body", body=wheel)
        self.good("add_constraint", constraint=self.joint(laws={"motor": {}}))
        self.good("add_constraint", constraint=Constraint(
            name="k", type="hinge", anchor_a=Point(0, 2, 0), body_b="wheel"))

        def gear(second="k", **settings):
            return messages.constraint("train", "gear", joints=("j", second), **{"ratio": -2.0, **settings})
        self.bad(["body_b", "'nobody'"], "add_constraint", constraint=gear("nobody"))
        self.bad(["ratio", "nan"], "add_constraint", constraint=gear(ratio=math.nan))
        self.bad(["coupling.pitch", "0.5"], "add_constraint", constraint=gear(pitch=0.5))
        self.bad(["axis_a"], "add_constraint", constraint=gear(axis_a=(0, 0, 1)))
        self.good("add_constraint", constraint=gear())
        self.good("set_motor_bias", constraint="j", bias=0.5)
        self.good("step", steps=100)
        self.reaches({"j": (0.5, 0.5, 0.0), "k": (0.25, 0.25, 0.0)}, 3 * [1e-9])
        self.bad(["'j'", "'train'"], "remove_constraint", name="j")
        text = self.good("save_scene").text
        for line in ("type: gear", "joints: [j, k]", "ratio: -2"):
            self.assertIn(line, text)
        self.good("remove_constraint", name="train")
        self.good("remove_constraint", name="j")
        self.good("remove_constraint", name="k")

    def test_gears_that_contradict_are_refused_by_name(self):
        for name in "abc":
            wheel = Body(name=name, mass=1.0,
                         shapes=[Shape(type=Shape.BOX, dimensions=[0.2, 0.2, 0.1])])
            wheel.pose.position.y = 2.0 + "abc".index(name)
            self.good("add_body", body=wheel)
            self.good("add_constraint", constraint=Constraint(
                name="hinge_" + name, type="hinge", anchor_a=Point(0, wheel.pose.position.y, 0),
                body_b=name))

        def gear(of, **settings):
            return messages.constraint("gear_" + of, "gear", joints=["hinge_" + one for one in of], **settings)
        self.good("add_constraint", constraint=gear("ab"))
        self.good("add_constraint", constraint=gear("bc"))
        # the first wheel rotates like the third, so the value between them can only be 0
        self.bad(["value", "contradicts", "'gear_ab'", "'gear_bc'", "0.5"], "add_constraint",
                 constraint=gear("ac", ratio=-1.0, value=0.5))
        self.bad(["value", "contradicts", "'gear_ab'"], "load_scene", text=self.good("save_scene").text +
                 "\n  - {name: x, type: gear, joints: [hinge_a, hinge_b], ratio: 1, value: 0.5}\n")
        self.good("add_constraint", constraint=gear("ac", ratio=-1.0, value=0.0))
        for enabled in (0.0, 1.0):
            self.good("set_constraint_properties", name="gear_ac", keys=["enabled"], values=[enabled])
        self.good("remove_constraint", name="gear_ac")
        self.good("add_constraint", constraint=gear("ac"))  # three in a ring are consistent: none rotates
        self.good("step", steps=10)

    def test_a_screw_and_a_pulley_by_service(self):
        self.good("add_constraint", constraint=self.joint(
            "screw", {"pitch": 0.5, "coordinates": [{}, {"motor": {"bias": 2.0 * math.pi}}]},
            anchor_a=Point(0.5, 0, 0), anchor_b=Point()))
        self.good("step", steps=100)  # a turn, and half a metre
        self.reaches({"j": (0.5, 0.5, 0.0), "j/1": (2.0 * math.pi, 2.0 * math.pi, 0.0)}, 3 * [1e-8])
        self.good("remove_constraint", name="j")
        for name, y in (("left", 1.0), ("right", -1.0)):
            self.good("add_constraint", constraint=Constraint(
                name=name, type="distance", anchor_a=Point(0.5, y, 3), body_b="bar",
                anchor_b=Point(0, 0, 0), free=True))
        self.good("add_constraint", constraint=Constraint(
            name="hoist", type="pulley", body_a="left", body_b="right"))
        self.good("step", steps=10)
        self.bad(["free", "'rope'"], "add_constraint", constraint=Constraint(
            name="x", type="rope", body_b="bar", free=True))

    def test_what_is_open_is_said_in_words(self):
        answer = self.good("add_constraint", constraint=self.joint(
            anchor_a=Point(0, 0.12, 0), axis_a=Vector3(0, 0, 1),
            axis_b=Vector3(0, math.sin(math.radians(170)), math.cos(math.radians(170)))))
        self.assertEqual(answer.status_message, "anchors 0.12 m apart, axes 170 degrees off; closes "
                         "in 0.5 s; was the axis meant the other way round?")
        self.good("step", steps=60)
        self.good("remove_constraint", name="j")
        answer = self.good("add_constraint", constraint=self.joint("ball", anchor_b=Point(),
                           anchor_a=call("get_body_state", name="bar").state.pose.position))
        self.assertEqual(answer.status_message, "")

    def test_a_constraint_is_disabled_and_closes_once_it_is_enabled_again(self):
        self.good("load_scene", text=HANGING)
        self.good("step", steps=10)
        answer = self.good("set_constraint_properties", name="j", keys=["enabled"], values=[0.0])
        self.assertEqual(answer.status_message, "")
        self.good("step", steps=20)  # falls by 0.2 m
        answer = self.good("set_constraint_properties", name="j", keys=["enabled"], values=[1.0])
        self.assertIn("m apart; closes in 0.5 s", answer.status_message)
        self.good("step", steps=60)
        listener = Listener(support.NODE + "/constraint_states", ConstraintStates)
        state = listener.present().constraints[0]
        self.assertFalse(state.closing)
        self.assertEqual(state.closing_error, 0.0)
        self.assertLess(abs(state.error), 1e-9)

    def test_properties_change_while_a_constraint_acts(self):
        self.good("add_constraint", constraint=self.joint(
            "cylindrical", {"coordinates": [{}, {"motor": {"bias": 0.5, "timeout": 0.3}}]},
            anchor_a=Point(0.5 * LENGTH, 0, 0), anchor_b=Point()))
        self.good("step", steps=10)
        self.good("set_constraint_properties", name="j", values=[0.25, 2.0, 1e6],
                  keys=["motor_position", "1/upper", "break_torque"])
        self.good("step", steps=90)
        # to the position within closing_time, and 0.3 s of 0.5 rad/s from the time of adding
        self.reaches({"j": (0.25, 0.0, 0.0), "j/1": (0.15, 0.0, 0.0)}, (1e-6, 1e-6, 1.0))
        text = self.good("save_scene").text
        for line in ("upper: 2", "break_torque: 1000000"):
            self.assertIn(line, text)
        self.good("set_constraint_properties", name="j", keys=["motor", "1/motor"],
                  values=[0.0, 0.0])
        for keys, values, words in ((["stifness"], [1.0], ["keys", "'stifness'"]),
                                    (["2/rest"], [1.0], ["keys", "'2/rest'"]),
                                    (["length"], [1.0], ["keys", "cylindrical", "'length'"]),
                                    (["rest"], [], ["values", "0 for 1"]),
                                    (["rest", "rest"], [1.0, 2.0], ["'rest'", "twice"]),
                                    (["enabled"], [0.5], ["enabled", "0 or 1"]),
                                    (["damping", "friction"], [1.0, math.nan], ["friction"])):
            self.bad(words, "set_constraint_properties", name="j", keys=keys, values=values)
        self.bad(["name", "none"], "set_constraint_properties", name="none", keys=[], values=[])

    def test_force_torque_of_names_that_have_one_topic_is_of_the_first(self):
        def scene(*names):
            return HANGING + "".join("  - {name: %s, type: ball, body_b: bar, anchor_a: [1, 0, 0], "
                                     "anchor_b: [0.5, 0, 0]}\n" % name for name in names)
        log = Listener("/rosout", Log)
        # a topic belongs to the first constraint in the scene, also where another one had it before
        self.good("load_scene", text=scene("wrist_1"))
        messages = Listener(support.NODE + "/force_torque/wrist_1", WrenchStamped)
        messages.find(lambda m: m.header.frame_id == "force_torque/wrist_1")
        self.good("load_scene", text=scene("wrist-1", "wrist_1"))
        stamp = messages.wait(lambda m: m.header.frame_id == "force_torque/wrist-1").header.stamp
        self.good("step", steps=1)
        messages.wait(lambda m: m.header.stamp > stamp)
        later = {m.header.frame_id for m in messages.messages if m.header.stamp >= stamp}
        self.assertEqual(later, {"force_torque/wrist-1"})
        log.find(lambda m: "'wrist_1' has no topic" in m.msg and "another constraint" in m.msg)

    def test_force_torque_is_in_the_frame_of_the_joint_on_b(self):
        self.good("load_scene", text=HANGING)
        self.good("set_constraint_properties", name="j", keys=["enabled"], values=[0.0])
        self.good("remove_constraint", name="j")
        self.good("add_constraint", constraint=Constraint(
            name="j", type="weld", body_b="bar", anchor_b=Point(-0.5 * LENGTH, 0, 0),
            axis_a=Vector3(1, 0, 0)))
        topic = support.NODE + "/force_torque/j"
        published = lambda: topic in [name for name, _ in rospy.get_published_topics()]
        support.wait_until(published, "the topic")
        transforms = Listener("/tf", TFMessage)
        transforms.wait()
        frames = lambda: {t.child_frame_id for m in transforms.messages for t in m.transforms}
        self.assertNotIn("force_torque/j", frames())
        wrenches = Listener(topic, WrenchStamped)
        self.good("step", steps=10)
        # the weight along y acts at the anchor; z of the frame is x of the bar, and -x its z
        weight = MASS * 9.81

        def is_told(message):
            f, t = message.wrench.force, message.wrench.torque
            return max(abs(f.x), abs(f.y - weight), abs(f.z), abs(t.x + 0.5 * LENGTH * weight),
                       abs(t.y), abs(t.z)) < 1e-9
        message = wrenches.wait(is_told)
        self.assertEqual(message.header.frame_id, "force_torque/j")
        support.wait_until(lambda: "force_torque/j" in frames(), "the frame of the wrench")
        self.good("remove_constraint", name="j")
        support.wait_until(lambda: not published(), "the end of the topic")

    def test_each_type_by_service_and_as_saved(self):
        above = {"anchor_a": Point(0, 0, 1)}
        for kind, keys, fields in (
                ("ball", {}, {}), ("hinge", {}, {}), ("slider", {}, {}), ("cylindrical", {}, {}),
                ("planar", {}, {}), ("universal", {}, {"axis_b": Vector3(1, 0, 0)}),
                ("weld", {}, {}), ("point_on_line", {}, {}), ("point_on_plane", {}, {}),
                ("parallel", {}, {}),
                ("screw", {"pitch": 0.5}, {}), ("distance", {}, above),
                ("distance", {"free": True}, above)):
            answer = self.good("add_constraint", constraint=self.joint(kind, keys, **fields))
            self.assertEqual(answer.status_message, "", kind)  # closed
            self.good("step", steps=10)
            text = self.good("save_scene").text
            self.assertIn("type: " + kind, text)
            self.good("load_scene", text=text)
            again = self.good("save_scene").text  # at another time
            self.assertEqual(again.partition("constraints:")[2], text.partition("constraints:")[2], kind)
            self.good("remove_constraint", name="j")

    def test_axes_that_cannot_be_are_refused(self):
        for words, constraint in (
                (["axis_a", "nan"], self.joint(axis_a=Vector3(math.nan, 0, 1))),
                (["axis_b", "inf"], self.joint(axis_b=Vector3(0, math.inf, 0))),
                (["axis_b", "universal"], self.joint("universal")),
                (["axis_b", "along axis_a", "(0, 0, -2)"], self.joint(
                    "universal", axis_a=Vector3(0, 0, 1), axis_b=Vector3(0, 0, -2))),
                (["axis_a", "ball"], self.joint("ball", axis_a=Vector3(0, 0, 1)))):
            self.bad(words, "add_constraint", constraint=constraint)
        self.bad(["axis_a", "(0, 0, 0)"], "load_scene",
                 text=HANGING.replace("type: ball", "type: hinge, axis_a: [0, 0, 0]"))
        # far from a right angle: reported, and then closed
        answer = self.good("add_constraint", constraint=self.joint(
            "universal", axis_a=Vector3(0, 0, 1), axis_b=Vector3(math.sqrt(3), 0, 1)))
        self.assertEqual(answer.status_message, "axes 30 degrees off; closes in 0.5 s")

    def test_laws_that_cannot_be_are_refused(self):
        first = "coordinates[0]."
        for laws, words in (({"coordinates": [{}, {"rest": 1.0}]}, ["coordinates", "1 coordinate", "got 2"]),
                            ({"lower": 1.0, "upper": -1.0}, [first + "upper", "-1"]),
                            ({"friction": math.nan}, [first + "friction", "nan"]),
                            ({"position": 1.0, "zero": 1.0}, [first + "zero", "1.0"]),
                            ({"motor": {"servo_frequency": 5.0}}, [first + "motor.servo_frequency", "POSITION=2"]),
                            ({"motor": {"position": 1.0, "force": 1.0}}, [first + "motor.force", "FORCE=3"]),
                            ({"motor": {"force": 1.0, "phase": 1.0}}, [first + "motor.phase", "RATE=1"]),
                            ({"motor": {"bias": math.inf}}, [first + "motor.bias", "inf"]),
                            ({"value": 1.0}, ["coupling.has_value", "hinge"])):
            self.bad(words, "add_constraint", constraint=self.joint(laws=laws))
        law = CoordinateLaw
        for each, words in ((law(motor=Motor(max_force=1.0)), [first + "motor.max_force", "mode"]),
                            (law(motor=Motor(mode=4)), [first + "motor.mode", "4"]),
                            (law(lower=-1.0), [first + "lower", "has_limits"]),
                            (law(position=0.5), [first + "position", "has_position"])):
            self.bad(words, "add_constraint", constraint=self.joint(coordinates=[each]))
        self.bad(["coordinates", "'weld'"], "add_constraint",
                 constraint=self.joint("weld", {"motor": {"bias": 1.0}}))
        self.good("add_constraint", constraint=self.joint("weld"))
        self.bad(["motor", "weld"], "set_motor_bias", constraint="j", bias=1.0)


if __name__ == "__main__":
    rospy.init_node("test_joints")
    rostest.rosrun("constraint_sim", "joints", Joints)
