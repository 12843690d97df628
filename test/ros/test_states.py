#!/usr/bin/env python3
"""States, wrenches, resets, constraints of any type, scenes saved and loaded."""
import math
import os
import tempfile

import rospy
import rostest
import yaml
from constraint_sim.msg import (Body, BodyState, Constraint, ConstraintStates, ContactStates,
                                CoordinateLaw, Motor, MotorBias, Parameter, Shape)
from geometry_msgs.msg import Point, Quaternion, Twist, Vector3, Wrench
from std_msgs.msg import String

import support
from support import Listener, call, properties, sphere

WEIGHTLESS = "world: {gravity: [0, 0, 0], time_step: 0.01}"
QUARTER_TURN_Z = Quaternion(0, 0, math.sqrt(0.5), math.sqrt(0.5))
NOT_FINITE = [math.nan, math.inf, -math.inf]


def xyz(v):
    return [v.x, v.y, v.z]


class States(support.ServiceCase):
    def setUp(self):
        support.empty_world()
        self.good("load_scene", text=WEIGHTLESS)

    def tearDown(self):
        Listener.stop_all()

    def near(self, found, expected, tolerance=1e-12):
        """Compares to 12 digits, the rounding of a few rotations of numbers of order 1."""
        for f, e in zip(found, expected):
            self.assertAlmostEqual(f, e, delta=tolerance)

    # ---- states and frames

    def state(self, name, frame=""):
        return self.good("get_body_state", name=name, reference_frame=frame).state

    def add_turning_frame(self):
        """Adds a body at (1, 0, 0), rotated by 90 degrees about z, that moves along y and rotates about z."""
        body = sphere("frame", 1, 0, 0, type=Body.KINEMATIC)
        body.pose.orientation = QUARTER_TURN_Z
        body.twist.linear.y = 0.5
        body.twist.angular.z = 2.0
        self.good("add_body", body=body)

    def test_get_body_state_in_the_world(self):
        body = sphere("b", 1, 2, 3)
        body.twist.linear.x = 4.0
        self.good("add_body", body=body)
        answer = self.good("get_body_state", name="b")
        self.assertEqual(answer.header.frame_id, "world")
        self.assertEqual(xyz(answer.state.pose.position), [1, 2, 3])
        self.assertEqual(xyz(answer.state.twist.linear), [4, 0, 0])

    def test_get_body_state_in_the_frame_of_a_body_that_moves_and_turns(self):
        self.add_turning_frame()
        self.good("add_body", body=sphere("b", 1, 3, 0))
        answer = self.good("get_body_state", name="b", reference_frame="frame")
        self.assertEqual(answer.header.frame_id, "frame")
        # world y is the frame's x; the frame's motion at b: (0, 0.5, 0) + 2z x 3y = (-6, 0.5, 0)
        self.near(xyz(answer.state.pose.position), [3, 0, 0])
        self.near(xyz(answer.state.twist.linear), [-0.5, -6, 0])
        self.near(xyz(answer.state.twist.angular), [0, 0, -2])

    def test_what_is_fixed_to_a_frame_has_no_velocity_in_it(self):
        self.add_turning_frame()
        self.good("add_body", body=sphere("b"))
        state = BodyState(name="b")
        state.pose.position = Point(1, 2, 3)
        self.good("set_body_state", state=state, reference_frame="frame")
        self.near(xyz(self.state("b").twist.linear), [-2 * 1, 0.5 - 2 * 2, 0])
        self.near(xyz(self.state("b").pose.position), [1 - 2, 1, 3])
        found = self.state("b", "frame")
        self.near(xyz(found.pose.position), [1, 2, 3])
        self.near(xyz(found.twist.linear) + xyz(found.twist.angular), [0] * 6)

    def test_set_body_state_in_a_frame_and_get_it_back(self):
        self.add_turning_frame()
        self.good("add_body", body=sphere("b", shapes=[Shape(type=Shape.BOX, dimensions=[0.1, 0.2, 0.3])]))
        state = BodyState(name="b")
        state.pose.position = Point(1, -2, 0.5)
        state.pose.orientation = Quaternion(0.5, 0.5, 0.5, 0.5)
        state.twist = Twist(Vector3(0.1, 0.2, 0.3), Vector3(0.4, 0.5, 0.6))
        self.good("set_body_state", state=state, reference_frame="frame")
        found = self.state("b", "frame")
        self.near(xyz(found.pose.position), [1, -2, 0.5])
        self.near(xyz(found.twist.linear) + xyz(found.twist.angular),
                  [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])

    def test_a_ray_hits_the_first_body(self):
        """A ball of 0.1 m at (1, 3, 0), before a box at y = 4."""
        self.add_turning_frame()
        self.good("add_body", body=sphere("ball", 1, 3, 0))
        wall = sphere("wall", 1, 5, 0, shapes=[Shape(type=Shape.BOX, dimensions=[2, 2, 2])], no_collision=True)
        self.good("add_body", body=wall)
        along_y = dict(origin=Point(1, 0.5, 0), direction=Vector3(0, 2, 0))
        ball = self.good("cast_ray", **along_y)
        self.assertEqual((ball.hit, ball.body, ball.inside, ball.header.frame_id), (True, "ball", False, "world"))
        self.near([ball.distance] + xyz(ball.point) + xyz(ball.normal), [2.4, 1, 2.9, 0, 0, -1, 0])
        behind = self.good("cast_ray", ignored=["ball"], **along_y)
        self.assertEqual(behind.body, "wall")
        self.near([behind.distance] + xyz(behind.normal), [3.5, 0, -1, 0])
        nothing = self.good("cast_ray", max_distance=2.3, **along_y)
        self.assertEqual((nothing.hit, nothing.body, nothing.distance), (False, "", 0.0))
        # world y is the x axis of the frame, whose origin is at (1, 0, 0) inside a ball
        found = self.good("cast_ray", origin=Point(0.5, 0, 0), direction=Vector3(1, 0, 0), reference_frame="frame")
        self.assertEqual((found.body, found.header.frame_id), ("ball", "frame"))
        self.near([found.distance] + xyz(found.point) + xyz(found.normal), [2.4, 2.9, 0, 0, -1, 0, 0])
        inside = self.good("cast_ray", origin=Point(1, 3, 0.01), direction=Vector3(0, 0, 5))
        self.assertEqual((inside.inside, inside.distance, xyz(inside.normal)), (True, 0.0, [0, 0, -1]))

    def test_rays_refuse_bad_input(self):
        self.good("add_body", body=sphere("b"))
        ahead = dict(direction=Vector3(1, 0, 0))
        self.bad(["direction", "(0, 0, 0)"], "cast_ray")
        self.bad(["max_distance", "-1"], "cast_ray", max_distance=-1.0, **ahead)
        self.bad(["reference_frame", "nobody"], "cast_ray", reference_frame="nobody", **ahead)
        self.bad(["ignored[1]", "nobody"], "cast_ray", ignored=["b", "nobody"], **ahead)
        self.bad(["max_distance", "nan"], "cast_ray", max_distance=math.nan, **ahead)
        for value in NOT_FINITE:
            self.bad(["origin"], "cast_ray", origin=Point(0, value, 0), **ahead)
            self.bad(["direction"], "cast_ray", direction=Vector3(0, value, 0))

    def test_closest_points_by_service(self):
        self.good("add_body", body=sphere("left", 1, 0, 0))
        self.good("add_body", body=sphere("right", 1, 2, 0))
        found = self.good("closest_points", body_a="left", body_b="right")
        self.assertEqual(found.header.frame_id, "world")
        self.near([found.distance] + xyz(found.point_a) + xyz(found.point_b) + xyz(found.normal),
                  [1.8, 1, 0.1, 0, 1, 1.9, 0, 0, -1, 0])
        self.bad(["body_b", "left"], "closest_points", body_a="left", body_b="left")
        self.bad(["body_a", "world"], "closest_points", body_a="world", body_b="left")
        self.bad(["body_b", "nobody"], "closest_points", body_a="left", body_b="nobody")

    def test_bodies_in_a_region(self):
        self.good("add_body", body=sphere("near", 1, 0, 0))
        self.good("add_body", body=sphere("far", 9, 0, 0))
        found = lambda *corners: self.good("bodies_in", min=Point(*corners[:3]), max=Point(*corners[3:])).bodies
        self.assertEqual(found(-1, -1, -1, 10, 1, 1), ["near", "far"])
        self.assertEqual(found(1.09, 0, 0, 2, 1, 1), ["near"])
        self.assertEqual(found(1.11, 0, 0, 2, 1, 1), [])
        self.bad(["max", "must be at least min"], "bodies_in", min=Point(1, 0, 0))
        self.bad(["min", "nan"], "bodies_in", min=Point(math.nan, 0, 0))

    def test_states_refuse_bad_input(self):
        self.good("add_body", body=sphere("b"))
        for name in ("", "world", "nobody"):
            self.bad(["name"], "get_body_state", name=name)
            self.bad(["name"], "set_body_state", state=BodyState(name=name))
        self.bad(["reference_frame", "nobody"], "get_body_state", name="b",
                 reference_frame="nobody")
        self.bad(["reference_frame", "nobody"], "set_body_state", state=BodyState(name="b"),
                 reference_frame="nobody")
        for value in NOT_FINITE:
            for field, path in (("position", ("pose", "position")),
                                ("linear_velocity", ("twist", "linear")),
                                ("angular_velocity", ("twist", "angular")),
                                ("orientation", ("pose", "orientation"))):
                state = BodyState(name="b")
                getattr(getattr(state, path[0]), path[1]).y = value
                self.bad([field, "%g" % value], "set_body_state", state=state)

    # ---- wrenches

    def wrench(self, **fields):
        fields.setdefault("duration", rospy.Duration(-1))
        return {"body_name": "b", **fields}

    def test_an_impulse_is_mass_times_the_change_of_velocity(self):
        self.good("add_body", body=sphere("b", mass=2.0))
        self.good("apply_body_wrench", **self.wrench(wrench=Wrench(force=Vector3(x=3)),
                                                     duration=rospy.Duration(0.125)))
        self.good("step", steps=50)
        self.near(xyz(self.state("b").twist.linear), [3 * 0.125 / 2, 0, 0])

    def test_wrenches_add_up_start_later_and_are_cleared(self):
        self.good("add_body", body=sphere("b"))
        now = properties().sim_time
        push = Wrench(force=Vector3(z=1))
        self.good("apply_body_wrench", **self.wrench(wrench=push))
        self.good("apply_body_wrench", **self.wrench(wrench=push, start_time=rospy.Time(now + 0.5)))
        self.good("step", steps=100)
        # stamps have nanoseconds
        self.near(xyz(self.state("b").twist.linear), [0, 0, 1.5], 1e-8)
        self.good("clear_body_wrenches", body_name="b")
        self.good("step", steps=100)
        self.near(xyz(self.state("b").twist.linear), [0, 0, 1.5], 1e-8)

    def test_a_wrench_honours_its_frame_and_point(self):
        self.add_turning_frame()
        self.good("add_body", body=sphere("b", 0, 0, 0))
        inertia = 0.4 * 0.1 ** 2
        # the frame's y is the world's -x
        self.good("apply_body_wrench", **self.wrench(
            reference_frame="frame", wrench=Wrench(force=Vector3(y=1)),
            duration=rospy.Duration(0.01)))
        self.good("step", steps=1)
        self.near(xyz(self.state("b").twist.linear), [-0.01, 0, 0])
        self.near(xyz(self.state("b").twist.angular), [0, 0, 0])
        # at (0, 0.1, 0.0) in the world, off the centre: rotates it about z
        self.good("set_body_state", state=BodyState(name="b"))
        self.good("apply_body_wrench", **self.wrench(
            reference_point=Point(0, 0.1, 0), wrench=Wrench(force=Vector3(x=1)),
            duration=rospy.Duration(0.01)))
        self.good("step", steps=1)
        self.near(xyz(self.state("b").twist.angular), [0, 0, -0.1 * 0.01 / inertia], 1e-9)

    def test_a_duration_of_zero_is_one_tick(self):
        self.good("add_body", body=sphere("b"))
        self.good("apply_body_wrench", body_name="b", wrench=Wrench(force=Vector3(x=1)))
        self.good("step", steps=10)
        self.near(xyz(self.state("b").twist.linear), [0.01, 0, 0])

    def test_wrenches_refuse_bad_input(self):
        self.good("add_body", body=sphere("b"))
        self.good("add_body", body=sphere("fixed", type=Body.STATIC))
        self.good("add_body", body=sphere("point", shapes=[Shape(type=Shape.POINT)]))
        for name in ("", "world", "nobody"):
            self.bad(["body_name"], "apply_body_wrench", body_name=name)
            self.bad(["body_name"], "clear_body_wrenches", body_name=name)
        self.bad(["fixed"], "apply_body_wrench", **self.wrench(body_name="fixed"))
        self.bad(["torque"], "apply_body_wrench",
                 **self.wrench(body_name="point", wrench=Wrench(torque=Vector3(z=1))))
        self.bad(["reference_frame", "nobody"], "apply_body_wrench",
                 **self.wrench(reference_frame="nobody"))
        for value in NOT_FINITE:
            self.bad(["force", "%g" % value], "apply_body_wrench",
                     **self.wrench(wrench=Wrench(force=Vector3(x=value))))
            self.bad(["torque", "%g" % value], "apply_body_wrench",
                     **self.wrench(wrench=Wrench(torque=Vector3(y=value))))
            self.bad(["reference_point", "%g" % value], "apply_body_wrench",
                     **self.wrench(reference_point=Point(z=value)))

    # ---- motor_bias

    def test_the_motor_bias_topic_drives_a_motor(self):
        self.good("add_body", body=sphere("b", 0, 0, 1))
        self.good("add_distance_constraint", name="rod", anchor_a=Point(0, 0, 3), body_b="b")
        listener = Listener(support.NODE + "/constraint_states", ConstraintStates)
        topic = rospy.Publisher(support.NODE + "/motor_bias", MotorBias, queue_size=10)
        support.wait_until(lambda: topic.get_num_connections() > 0, "the node")
        before = properties().state_hash
        topic.publish(constraint="nothing", bias=1.0)  # a warning, without other effects
        topic.publish(constraint="rod", bias=-0.5, timeout=0.2)
        support.wait_until(lambda: properties().state_hash != before, "the bias")
        self.good("step", steps=10)
        listener.wait(lambda m: m.constraints and m.constraints[0].bias == -0.5)
        self.good("step", steps=90)
        # 0.2 s of 0.5 m/s, and no lag of Baumgarte for a weightless load
        self.near(xyz(self.state("b").pose.position), [0, 0, 1.1], 1e-9)

    # ---- constraints of any type

    def constraint(self, kind, **fields):
        return Constraint(name="c", type=kind, body_b="b", **fields)

    def test_add_constraint_of_each_type(self):
        for kind, fields in (("distance", {}), ("distance", {"min_length": 0.5, "max_length": 2}),
                             ("rope", {}), ("strut", {"min_length": 0.5}),
                             ("spring", {"coordinates": [CoordinateLaw(frequency=2.0, damping_ratio=0.1)]}),
                             ("spring", {"coordinates": [CoordinateLaw(stiffness=10.0)]}), ("ball", {})):
            self.good("add_body", body=sphere("b", 1, 0, 0))
            answer = self.good("add_constraint", constraint=self.constraint(kind, **fields))
            self.assertEqual(answer.initial_error, 1.0 if kind == "ball" else 0.0)
            self.good("step", steps=10)
            self.assertEqual(self.good("remove_body", name="b").removed_constraints, ["c"])

    def test_add_constraint_takes_each_field(self):
        self.good("add_body", body=sphere("b", 1, 0, 0))
        self.good("add_constraint", constraint=self.constraint(
            "distance", length=1.5, anchor_a=Point(0.5, 0, 0), baumgarte=0.2, break_force=100.0,
            collide_connected=True, coordinates=[CoordinateLaw(motor=Motor(
                mode=Motor.RATE, bias=0.1, amplitude=0.2, frequency=3.0, phase=0.4, max_force=50.0,
                timeout=7.0))]))
        text = self.good("save_scene").text
        for line in ("length: 1.5", "anchor_a: [0.5, 0, 0]", "baumgarte: 0.2", "break_force: 100",
                     "bias: 0.1", "amplitude: 0.2", "frequency: 3", "max_force: 50",
                     "collide_connected: true", "timeout: 7"):
            self.assertIn(line, text)

    def test_add_constraint_refuses_bad_input(self):
        self.good("add_body", body=sphere("b", 1, 0, 0))
        for kind in ("cog", "", "Distance"):
            self.bad(["type", kind], "add_constraint", constraint=self.constraint(kind))
        for kind, field in (("rope", "length"), ("ball", "length"), ("weld", "max_length"),
                            ("strut", "max_length"), ("spring", "min_length")):
            self.bad([field, kind], "add_constraint",
                     constraint=self.constraint(kind, **{field: 1.0}))
        self.bad(["axis_a"], "add_constraint",
                 constraint=self.constraint("distance", axis_a=Vector3(0, 0, 1)))
        self.bad(["frequency"], "add_constraint", constraint=self.constraint("spring"))
        first = "coordinates[0]."
        for kind, law, words in (
                ("strut", CoordinateLaw(stiffness=1.0), [first + "stiffness", "'strut'"]),
                ("strut", CoordinateLaw(frequency=1.0), [first + "frequency", "'strut'"]),
                ("distance", CoordinateLaw(friction=1.0), [first + "friction", "'distance'"]),
                ("distance", CoordinateLaw(has_limits=True), [first + "has_limits", "'distance'"]),
                ("strut", CoordinateLaw(motor=Motor(mode=Motor.FORCE, force=1.0)), [first + "motor.mode", "3"]),
                ("ball", CoordinateLaw(), ["coordinates", "'ball'", "0 coordinates, got 1"])):
            self.bad(words, "add_constraint", constraint=self.constraint(kind, coordinates=[law]))
        self.bad(["parameters", "'drag'"], "add_constraint",
                 constraint=self.constraint("ball", parameters=[Parameter("drag", 1.0)]))
        self.bad(["break_torque", "'distance'"], "add_constraint",
                 constraint=self.constraint("distance", break_torque=1.0))
        for value in NOT_FINITE:
            for field in ("length", "min_length", "max_length", "baumgarte", "break_force"):
                if field == "max_length" and value == math.inf:
                    continue  # the type has no limits
                self.bad([field, "%g" % value], "add_constraint",
                         constraint=self.constraint("distance", **{field: value}))
            for field in ("frequency", "damping_ratio", "stiffness", "damping"):
                self.bad([field, "%g" % value], "add_constraint", constraint=self.constraint(
                    "distance", coordinates=[CoordinateLaw(**{field: value})]))
            for field in ("bias", "amplitude", "frequency", "phase", "max_force", "timeout"):
                self.bad([first + "motor." + field, "%g" % value], "add_constraint",
                         constraint=self.constraint("distance", coordinates=[CoordinateLaw(
                             motor=Motor(mode=Motor.RATE, **{field: value}))]))
        self.bad(["max_length", "min_length"], "add_constraint",
                 constraint=self.constraint("distance", min_length=2.0, max_length=1.0))

    def test_a_constraint_that_does_not_fit_closes_smoothly(self):
        self.good("add_body", body=sphere("b", 1, 0, 0))
        answer = self.good("add_distance_constraint", name="c", body_b="b", length=0.5)
        self.assertEqual(answer.initial_error, 0.5)
        # half of the error in half of closing_time, 0.5 s, and all of it at the end
        for steps, x in ((25, 0.75), (25, 0.5), (25, 0.5)):
            self.near(xyz(self.good("step", steps=steps).bodies[0].pose.position), [x, 0, 0], 1e-9)

    # ---- contacts and plan

    def test_contact_states(self):
        self.good("load_scene", text="world: {gravity: [0, 0, -10], time_step: 0.01}")
        listener = Listener(support.NODE + "/contact_states", ContactStates)
        self.good("add_body", body=sphere("floor", type=Body.STATIC, shapes=[Shape(type=Shape.PLANE)]))
        self.good("add_body", body=sphere("ball", z=0.1, mass=3.0))
        self.good("step", steps=300)
        contact = listener.present().contacts[0]
        self.assertEqual({contact.body_a, contact.body_b}, {"ball", "floor"})
        # at rest it carries the weight; a hundred times the rounding of warm starting
        self.assertAlmostEqual(contact.normal_force, 30.0, places=6)
        self.assertEqual(abs(contact.normal.z), 1.0)

    def test_the_plan_is_latched_and_follows_the_scene(self):
        self.good("load_scene", path="pendulum")
        listener = Listener(support.NODE + "/plan", String)
        support.wait_until(lambda: listener.messages and "collision" in listener.messages[-1].data,
                           "the plan")
        before = listener.messages[-1].data
        self.good("load_scene", path="falling_balls")
        support.wait_until(lambda: listener.messages[-1].data != before, "another plan")

    def check_plan_changes(self, part, steps, before, after):
        """Expects that these steps, without an edit, change a part of the plan."""
        def says(text):
            return yaml.safe_load(text)[part]
        plans = Listener(support.NODE + "/plan", String)
        support.wait_until(lambda: plans.messages and says(plans.messages[-1].data) == before,
                           "the plan before")
        self.good("step", steps=steps)
        support.wait_until(lambda: says(plans.messages[-1].data) == after, "the plan after")
        # a later subscriber gets the changed plan
        latched = Listener(support.NODE + "/plan", String)
        support.wait_until(lambda: latched.messages, "the latched plan")
        self.assertEqual(latched.messages[0], plans.messages[-1])

    def test_the_plan_follows_a_constraint_that_tears(self):
        # 10 N of weight hold; another 5 N after 0.1 s exceed the limit
        self.good("load_scene", text="""
world: {gravity: [0, 0, -10], time_step: 0.01}
bodies: [{name: load, mass: 1, position: [0, 0, 1]}]
constraints: [{name: fuse, anchor_a: [0, 0, 2], body_b: load, break_force: 12}]
wrenches: [{body: load, force: [0, 0, -5], start: 0.1}]""")
        self.good("step", steps=5)
        counts = {"rod": 1, "limited": 0, "spring": 0, "ball": 0, "motor": 0, "broken": 0}
        self.check_plan_changes("constraints", 10, counts, {**counts, "broken": 1})

    def test_the_plan_follows_a_wrench_that_is_over(self):
        self.good("add_body", body=sphere("b"))
        for duration, steps in ((0.05, 6), (0.0, 1)):  # a duration of 0 is one tick
            self.good("apply_body_wrench", **self.wrench(wrench=Wrench(force=Vector3(x=1)),
                                                         duration=rospy.Duration(duration)))
            self.check_plan_changes("wrenches", steps, 1, 0)

    # ---- resets

    def test_reset_world_brings_everything_back_and_time_goes_on(self):
        self.good("load_scene", path="platform")
        start = self.good("step", steps=0).bodies
        self.good("step", steps=100)
        self.good("set_motor_bias", constraint=properties().constraints[0], bias=0.5)
        self.good("apply_body_wrench", body_name=start[-1].name, duration=rospy.Duration(-1),
                  wrench=Wrench(force=Vector3(x=100)))
        self.good("step", steps=100)
        before = properties()
        call("reset_world")
        after = properties()
        self.assertEqual((after.step, after.sim_time), (before.step, before.sim_time))
        self.assertEqual(after.bodies, before.bodies)
        self.assertEqual(self.good("step", steps=0).bodies, start)

    def test_reset_simulation_is_a_fresh_start(self):
        self.good("load_scene", path="bridge")
        call("reset_simulation")
        self.assertEqual((properties().step, properties().sim_time), (0, 0.0))
        first = self.good("step", steps=200).state_hash
        call("reset_simulation")
        self.assertEqual(self.good("step", steps=200).state_hash, first)

    # ---- scenes saved and loaded

    def test_a_live_edited_scene_saved_and_loaded_goes_on_alike(self):
        self.good("load_scene", path="oscillator")
        self.good("step", steps=150)
        self.good("add_body", body=sphere("late", 2, 0, 4))
        self.good("add_constraint", constraint=Constraint(
            name="late_rope", type="rope", body_b="late", anchor_a=Point(2, 0, 5),
            coordinates=[CoordinateLaw(motor=Motor(mode=Motor.RATE, bias=-0.1))]))
        self.good("step", steps=37)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "saved.yaml")
            text = self.good("save_scene", path=path).text
            with open(path) as file:
                self.assertEqual(file.read(), text)
            expected = self.good("step", steps=100).bodies
            self.good("load_scene", path=path)
        found = self.good("step", steps=100).bodies
        for f, e in zip(found, expected):
            self.assertEqual(f.name, e.name)
            # differences are rounding, and the restart of warm starting: a few digits of 1e-6 m
            self.near(xyz(f.pose.position), xyz(e.pose.position), 1e-4)
        self.good("load_scene", text=text)
        again = self.good("save_scene").text
        self.assertEqual(again.count("- name"), text.count("- name"))

    def test_save_scene_refuses_a_path_that_cannot_be_written(self):
        self.bad(["path", "/no/such/folder"], "save_scene", path="/no/such/folder/scene.yaml")


if __name__ == "__main__":
    rospy.init_node("test_states")
    rostest.rosrun("constraint_sim", "states", States)
