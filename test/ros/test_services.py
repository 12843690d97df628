#!/usr/bin/env python3
"""Every service with valid input, and every field with invalid input."""
import math
import os
import tempfile
import threading

import rospy
import rostest
from constraint_sim.msg import Body, BodyState, Shape
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

import support
from support import call, properties, sphere

NOT_FINITE = [math.nan, math.inf, -math.inf]


class Services(support.ServiceCase):
    told = ""
    def setUp(self):
        support.empty_world()

    # ---- add_body, remove_body

    def test_add_body_and_remove_body(self):
        self.good("add_body", body=sphere("ball", 1, 2, 3))
        self.assertEqual(properties().bodies, ["ball"])
        self.good("add_body", body=sphere("anchor", type=Body.STATIC, mass=0.0))
        self.good("add_distance_constraint", name="rod", body_a="anchor", body_b="ball")
        answer = self.good("remove_body", name="ball")
        self.assertEqual(answer.removed_constraints, ["rod"])
        self.assertEqual(properties().bodies, ["anchor"])
        self.assertEqual(properties().constraints, [])

    def test_add_body_of_each_shape_and_type(self):
        shapes = [Shape(type=Shape.POINT), Shape(type=Shape.SPHERE, dimensions=[0.1]),
                  Shape(type=Shape.BOX, dimensions=[0.1, 0.2, 0.3]), Shape(type=Shape.PLANE)]
        for shape in shapes:
            for kind in (Body.DYNAMIC, Body.STATIC, Body.KINEMATIC):
                body = sphere("b%d_%d" % (shape.type, kind), shapes=[shape], type=kind)
                if shape.type == Shape.PLANE and kind == Body.DYNAMIC:
                    self.bad(["type", "dynamic"], "add_body", body=body)
                else:
                    self.good("add_body", body=body)

    def test_add_body_refuses_each_bad_number(self):
        for value in NOT_FINITE + [0.0, -1.0]:
            shown = "%g" % value
            self.bad(["mass", shown], "add_body", body=sphere("b", mass=value))
            self.bad(["radius", shown], "add_body",
                     body=sphere("b", shapes=[Shape(type=Shape.SPHERE, dimensions=[value])]))
            for axis, size in (("x", [value, 1, 1]), ("y", [1, value, 1]), ("z", [1, 1, value])):
                self.bad(["size." + axis, shown], "add_body",
                         body=sphere("b", shapes=[Shape(type=Shape.BOX, dimensions=size)]))
        for value in NOT_FINITE + [-1.0]:
            shown = "%g" % value
            self.bad(["friction", shown], "add_body", body=sphere("b", friction=value))
            self.bad(["restitution", shown], "add_body", body=sphere("b", restitution=value))
            self.bad(["inertia", shown], "add_body",
                     body=sphere("b", inertia=Vector3(1, value, 1)))
        self.bad(["restitution", "1.5"], "add_body", body=sphere("b", restitution=1.5))
        self.bad(["inertia", "0"], "add_body", body=sphere("b", inertia=Vector3(1, 0, 1)))
        for value in NOT_FINITE:
            shown = "%g" % value
            self.bad(["position", shown], "add_body", body=sphere("b", x=value))
            body = sphere("b")
            body.twist.linear.y = value
            self.bad(["linear_velocity", shown], "add_body", body=body)
            body = sphere("b")
            body.twist.angular.z = value
            self.bad(["angular_velocity", shown], "add_body", body=body)
            body = sphere("b")
            body.pose.orientation.w = value
            self.bad(["orientation", shown], "add_body", body=body)
        body = sphere("b")
        body.pose.orientation = Quaternion(0, 0, 0, 2)
        self.bad(["orientation", "2"], "add_body", body=body)

    def test_add_body_refuses_bad_names_shapes_and_types(self):
        self.good("add_body", body=sphere("ball"))
        self.bad(["name", "ball"], "add_body", body=sphere("ball"))
        for name in ("", "world", "/ball", "two words", "-x", "ä"):
            self.bad(["name", name], "add_body", body=sphere(name))
        self.bad(["shapes[0].dimensions", "2"], "add_body",
                 body=sphere("b", shapes=[Shape(type=Shape.SPHERE, dimensions=[1, 2])]))
        self.bad(["shapes[0].dimensions", "0"], "add_body",
                 body=sphere("b", shapes=[Shape(type=Shape.BOX)]))
        self.bad(["shapes[0].type", "9"], "add_body", body=sphere("b", shapes=[Shape(type=9)]))
        self.bad(["shapes[0].triangles", "got 0"], "add_body", body=sphere("b", shapes=[Shape(type=Shape.MESH)]))
        self.bad(["shapes[0].vertices", "4"], "add_body",
                 body=sphere("b", shapes=[Shape(type=Shape.SPHERE, dimensions=[1], vertices=[Point()] * 4)]))
        self.bad(["shapes[0]", "part", "sphere"], "add_body", body=sphere("b", shapes=[Shape(), Shape()]))
        self.bad(["color", "1.5"], "add_body", body=sphere("b", color=ColorRGBA(r=1.5)))
        self.bad(["type", "7"], "add_body", body=sphere("b", type=7))

    # ---- meshes

    def channel(self):
        """Returns a mesh of a channel of 3 x 1 x 2 m along y, open above, with walls and floor of 1 m, and the path
        of a file with it."""
        outline = [(-1.5, 0), (1.5, 0), (1.5, 2), (0.5, 2), (0.5, 1), (-0.5, 1), (-0.5, 2), (-1.5, 2)]
        count = len(outline)
        points = [(x, y, z) for y in (-0.5, 0.5) for x, z in outline]
        front = [(0, 1, 4), (1, 2, 3), (1, 3, 4), (0, 4, 5), (0, 5, 7), (5, 6, 7)]
        triangles = front + [(c + count, b + count, a + count) for a, b, c in front]
        for i in range(count):
            j = (i + 1) % count
            triangles += [(i, i + count, j), (j, i + count, j + count)]
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        path = os.path.join(folder.name, "channel.obj")
        with open(path, "w") as file:
            file.writelines("v %g %g %g\n" % point for point in points)
            file.writelines("f %d %d %d\n" % tuple(i + 1 for i in triangle) for triangle in triangles)
        return Shape(type=Shape.MESH, vertices=[Point(*point) for point in points],
                     triangles=[i for triangle in triangles for i in triangle]), path

    def test_a_ball_falls_into_a_mesh(self):
        """A ball rests on the floor of a channel, and on top of its convex hull. Replays read no file."""
        mesh, path = self.channel()
        uri = "file://" + path
        for shape, sentence, floor in (
                (mesh, "shapes[0] collides as 3 convex parts", 1.0),
                (Shape(type=Shape.MESH, mesh_resource=uri), "3 convex parts", 1.0),
                (Shape(type=Shape.HULL, mesh_resource=path), "its convex hull", 2.0)):
            support.empty_world()
            ball = Shape(type=Shape.SPHERE, dimensions=[0.3])
            self.good("add_body", body=sphere("ball", 0.05, 0, 2.5, shapes=[ball]))
            answer = call("add_body", body=sphere("channel", type=Body.STATIC, shapes=[shape]))
            self.assertTrue(answer.success, answer.status_message)
            self.assertIn(sentence, answer.status_message)
            self.good("step", steps=300)
            height = call("get_body_state", name="ball").state.pose.position.z
            self.assertAlmostEqual(height, floor + 0.3, delta=1e-3)  # within the contact's slop
            self.assertIn("hull: {vertices:", call("save_scene").text)

    def test_a_mesh_is_shown_by_its_file(self):
        """The origin of the file is 0.2 m above that of a body that moves, and the marker is there."""
        _, path = self.channel()
        shown = support.Listener(support.NODE + "/markers", MarkerArray)
        shape = Shape(type=Shape.MESH, mesh_resource="file://" + path, mesh_scale=Vector3(0.1, 0.1, 0.1),
                      pose=Pose(position=Point(0, 0, 0.2)))
        body = sphere("channel", 0, 0, 1, type=Body.KINEMATIC, shapes=[shape], color=ColorRGBA(g=0.5))
        body.twist.linear.x = 1.0
        self.assertTrue(call("add_body", body=body).success)

        def visuals(message):
            return [m for m in message.markers if m.ns == "visuals" and m.action == Marker.ADD]
        marker = visuals(shown.find(visuals, "a visual"))[0]
        self.assertEqual(marker.type, Marker.MESH_RESOURCE)
        self.assertEqual(marker.mesh_resource, "file://" + path)
        self.assertEqual((marker.scale.x, marker.scale.y, marker.scale.z), (0.1, 0.1, 0.1))
        self.assertAlmostEqual(marker.color.g, 0.5)
        self.assertFalse(marker.mesh_use_embedded_materials)
        self.assertAlmostEqual(marker.pose.position.z, 1.2)
        self.good("step", steps=100)
        x = call("get_body_state", name="channel").state.pose.position.x
        self.assertGreater(x, 0.9)
        shown.find(lambda m: any(abs(v.pose.position.x - x) < 1e-9 for v in visuals(m)), "the visual there")
        self.good("remove_body", name="channel")
        shown.find(lambda m: any(v.ns == "visuals" and v.action == Marker.DELETE for v in m.markers), "its end")
        support.Listener.stop_all()

    def test_add_body_refuses_each_bad_mesh(self):
        mesh, path = self.channel()
        for named, fields in (
                (["mesh_resource", "'package://nowhere/x.stl'"], dict(mesh_resource="package://nowhere/x.stl")),
                (["mesh_resource", "'http://localhost/x.stl'"], dict(mesh_resource="http://localhost/x.stl")),
                (["mesh_resource", "'x.stl'"], dict(mesh_resource="x.stl")),
                (["mesh_resource", "cannot be read"], dict(mesh_resource="/etc/hostname")),
                (["mesh_scale", "1, 0, 1"], dict(mesh_resource=path, mesh_scale=Vector3(1, 0, 1))),
                (["mesh_scale", "nan"], dict(mesh_resource=path, mesh_scale=Vector3(1, math.nan, 1))),
                (["vertices", "16"], dict(mesh_resource=path, vertices=mesh.vertices)),
                (["triangles[2]", "16"], dict(vertices=mesh.vertices, triangles=[0, 1, 16])),
                (["triangles", "got 2"], dict(vertices=mesh.vertices, triangles=[0, 1])),
                (["dimensions", "got 1"], dict(mesh_resource=path, dimensions=[1]))):
            self.bad(["shapes[0]."] + named, "add_body", body=sphere(
                "b", type=Body.STATIC, shapes=[Shape(type=Shape.MESH, **fields)]))
        self.bad(["bodies[1]", "shapes[0].mesh_resource"], "apply_edits", bodies=[
            sphere("a"), sphere("b", shapes=[Shape(type=Shape.MESH, mesh_resource="/x.stl")])])

    def test_a_cylinder_rolls_down_a_slope(self):
        self.good("load_scene", text="world: {method: sequential_impulses}")
        tilt = Quaternion(0, math.sin(0.1), 0, math.cos(0.1))  # 0.2 rad about y
        self.good("add_body", body=sphere("slope", type=Body.STATIC, friction=1.0,
                                          shapes=[Shape(type=Shape.PLANE)]))
        self.good("set_body_state", state=BodyState(name="slope", pose=Pose(orientation=tilt)))
        half = math.sqrt(0.5)
        roller = sphere("roller", 0.2 * math.sin(0.2), 0, 0.2 * math.cos(0.2), friction=1.0,
                        shapes=[Shape(type=Shape.CYLINDER, dimensions=[0.2, 0.5])])
        roller.pose.orientation = Quaternion(half, 0, 0, half)
        self.good("add_body", body=roller)
        self.good("step", steps=100)
        v = call("get_body_state", name="roller").state.twist.linear
        # two thirds of the sliding acceleration, within the contact's slop over the radius, and the first
        # sweeps
        self.assertAlmostEqual(v.x / math.cos(0.2), 2.0 / 3.0 * 9.81 * math.sin(0.2), delta=0.02)
        self.assertIn("cylinder: {radius: 0.2, length: 0.5}", call("save_scene").text)
        for dimensions, named in (([0.1], "1"), ([], "0"), ([0.1, -1], "-1"), ([0, 1], "radius")):
            self.bad(["shape", named], "add_body",
                     body=sphere("b", shapes=[Shape(type=Shape.CYLINDER, dimensions=dimensions)]))

    def test_a_capsule_rolls_down_a_slope(self):
        self.good("load_scene", text="world: {}")
        tilt = Quaternion(0, math.sin(0.1), 0, math.cos(0.1))  # 0.2 rad about y
        self.good("add_body", body=sphere("slope", type=Body.STATIC, friction=1.0,
                                          shapes=[Shape(type=Shape.PLANE)]))
        self.good("set_body_state", state=BodyState(name="slope", pose=Pose(orientation=tilt)))
        half = math.sqrt(0.5)
        roller = sphere("roller", 0.2 * math.sin(0.2), 0, 0.2 * math.cos(0.2), friction=1.0,
                        shapes=[Shape(type=Shape.CAPSULE, dimensions=[0.2, 0.4])])
        roller.pose.orientation = Quaternion(half, 0, 0, half)
        self.good("add_body", body=roller)
        self.good("step", steps=100)
        v = call("get_body_state", name="roller").state.twist.linear
        # 0.6 of the mass is in the cylinder: I = (0.6 / 2 + 0.4 * 0.4) m r^2. Events are exact, but for the step in
        # which the two contacts begin.
        a = 9.81 * math.sin(0.2) / 1.46
        self.assertAlmostEqual(v.x / math.cos(0.2), a, delta=1e-6)
        self.assertIn("capsule: {radius: 0.2, length: 0.4}", call("save_scene").text)
        for dimensions, named in (([0.1], "1"), ([], "0"), ([0.1, -1], "-1"), ([0, 1], "radius")):
            self.bad(["shape", named], "add_body",
                     body=sphere("b", shapes=[Shape(type=Shape.CAPSULE, dimensions=dimensions)]))

    def test_remove_body_refuses_the_unknown_and_the_world(self):
        for name in ("nobody", "", "world"):
            self.bad(["name"], "remove_body", name=name)

    # ---- constraints

    def test_add_distance_constraint_takes_the_present_distance(self):
        self.good("add_body", body=sphere("a", 0, 0, 1))
        self.good("add_body", body=sphere("b", 3, 4, 1))
        answer = self.good("add_distance_constraint", name="rod", body_a="a", body_b="b")
        self.assertEqual(answer.initial_error, 0.0)
        answer = self.good("add_distance_constraint", name="tight", body_a="a", body_b="b",
                           length=4.5, told="length 0.5 m off; closes in 0.5 s")
        self.assertAlmostEqual(answer.initial_error, 0.5, places=12)
        self.assertEqual(properties().constraints, ["rod", "tight"])
        self.good("remove_constraint", name="tight")
        self.assertEqual(properties().constraints, ["rod"])

    def test_add_distance_constraint_honours_anchors_and_the_world(self):
        self.good("add_body", body=sphere("a", 0, 0, 1))
        for name, body in (("empty", ""), ("named", "world")):
            answer = self.good("add_distance_constraint", name=name, body_a=body,
                               anchor_a=Point(0, 0, 3), body_b="a", anchor_b=Point(0, 0, 0.5),
                               length=1.0, told="length 0.5 m off; closes in 0.5 s")
            self.assertAlmostEqual(answer.initial_error, 0.5, places=12)

    def test_coincident_anchors_make_a_ball_joint(self):
        self.good("add_body", body=sphere("a", 0, 0, 1))
        self.good("add_distance_constraint", name="joint", body_a="a", anchor_a=Point(0, 0, 0.5),
                  anchor_b=Point(0, 0, 1.5))
        end = [b for b in call("step", steps=200).bodies if b.name == "a"][0].pose.position
        self.assertAlmostEqual(math.dist((end.x, end.y, end.z), (0, 0, 1.5)), 0.5, places=3)

    def test_constraints_refuse_bad_input(self):
        self.good("add_body", body=sphere("a", 0, 0, 1))
        self.good("add_body", body=sphere("b", 1, 0, 1))
        self.good("add_body", body=sphere("fixed", 2, 0, 1, type=Body.STATIC))
        self.good("add_body", body=sphere("point", 3, 0, 1, shapes=[Shape(type=Shape.POINT)]))
        self.good("add_distance_constraint", name="rod", body_a="a", body_b="b")
        ends = {"body_a": "a", "body_b": "b"}
        for name in ("rod", "", "world", "a b"):
            self.bad(["name", name], "add_distance_constraint", name=name, **ends)
        self.bad(["body_a", "x"], "add_distance_constraint", name="c", body_a="x", body_b="b")
        self.bad(["body_b", "x"], "add_distance_constraint", name="c", body_a="a", body_b="x")
        self.bad(["body_b", "'a'"], "add_distance_constraint", name="c", body_a="a", body_b="a")
        self.bad(["body_b", "world"], "add_distance_constraint", name="c")
        self.bad(["body_b", "fixed"], "add_distance_constraint", name="c", body_b="fixed")
        self.bad(["anchor_b", "point"], "add_distance_constraint", name="c", body_a="a",
                 body_b="point", anchor_b=Point(0.1, 0, 0))
        for value in NOT_FINITE:
            shown = "%g" % value
            self.bad(["length", shown], "add_distance_constraint", name="c", length=value, **ends)
            self.bad(["anchor_a", shown], "add_distance_constraint", name="c",
                     anchor_a=Point(0, value, 0), **ends)
            self.bad(["anchor_b", shown], "add_distance_constraint", name="c",
                     anchor_b=Point(0, 0, value), **ends)
        for name in ("nothing", ""):
            self.bad(["name"], "remove_constraint", name=name)

    # ---- set_motor_bias

    def test_a_motor_shortens_its_rod(self):
        self.good("add_body", body=sphere("load", 0, 0, 1))
        self.good("add_distance_constraint", name="cable", anchor_a=Point(0, 0, 3), body_b="load")
        self.good("set_motor_bias", constraint="cable", bias=-0.5, timeout=1.0)
        tick = properties().time_step
        height = call("step", steps=round(3.0 / tick)).bodies[0].pose.position.z
        # hauled in for 1 s of the 3; the load hangs straight, so only Baumgarte's lag remains
        self.assertAlmostEqual(height, 1.5, places=2)

    def test_set_motor_bias_refuses_bad_input(self):
        self.good("add_body", body=sphere("load", 0, 0, 1))
        self.good("add_distance_constraint", name="cable", anchor_a=Point(0, 0, 3), body_b="load")
        self.good("add_distance_constraint", name="ball", anchor_a=Point(0, 0, 1), body_b="load")
        self.bad(["constraint", "rope"], "set_motor_bias", constraint="rope", bias=1.0)
        self.bad(["ball"], "set_motor_bias", constraint="ball", bias=1.0)
        for value in NOT_FINITE:
            self.bad(["bias", "%g" % value], "set_motor_bias", constraint="cable", bias=value)
        for value in NOT_FINITE + [-1.0]:
            self.bad(["max_force", "%g" % value], "set_motor_bias", constraint="cable",
                     max_force=value)
            self.bad(["timeout", "%g" % value], "set_motor_bias", constraint="cable",
                     timeout=value)

    # ---- time

    def test_pause_step_and_unpause(self):
        self.good("add_body", body=sphere("ball", 0, 0, 100))
        start = properties()
        self.assertTrue(start.paused)
        answer = self.good("step", steps=10)
        after = properties()
        self.assertEqual(after.step, start.step + 10)
        self.assertAlmostEqual(after.sim_time, start.sim_time + 10 * start.time_step, places=9)
        self.assertEqual(answer.state_hash, after.state_hash)
        self.assertEqual([b.name for b in answer.bodies], ["ball"])
        self.assertEqual(properties().state_hash, after.state_hash)  # it stands

        call("unpause_physics")
        support.wait_until(lambda: properties().step > after.step + 5, "steps of a running world")
        answer = call("step", steps=1)
        self.assertFalse(answer.success)
        self.assertIn("paused", answer.status_message)
        call("pause_physics")
        stood = properties()
        self.assertTrue(stood.paused)
        self.assertEqual(self.good("step", steps=0).state_hash, stood.state_hash)

    def test_edits_take_effect_while_a_long_step_runs(self):
        self.good("add_body", body=sphere("ball", 0, 0, 100))
        first = properties().step
        answers = []
        thread = threading.Thread(target=lambda: answers.append(call("step", steps=4294967295)))
        thread.start()
        support.wait_until(lambda: properties().step > first, "the first step")
        edit = self.good("add_body", body=sphere("late", 5, 0, 100))
        support.wait_until(lambda: properties().step > edit.step, "steps after it")
        call("pause_physics")  # ends it
        thread.join()
        self.assertGreater(edit.step, first)
        self.assertEqual(len(answers[0].bodies), 2)

    def test_the_answer_says_when_an_edit_took_effect(self):
        call("step", steps=5)
        state = properties()
        answer = self.good("add_body", body=sphere("ball"))
        self.assertEqual(answer.step, state.step)
        self.assertAlmostEqual(answer.applied_at.to_sec(), state.sim_time, places=8)

    # ---- scenes

    def test_load_scene_by_name_and_text(self):
        before = properties()
        self.good("load_scene", path="pendulum")
        after = properties()
        self.assertTrue(after.bodies)
        self.assertEqual(after.step, before.step)  # time goes on
        self.assertEqual(after.sim_time, before.sim_time)
        self.good("load_scene", path="package://constraint_sim/config/scenes/bridge.yaml")
        self.good("load_scene",
                  text="world: {gravity: [0, 0, 0], time_step: 0.002}\n"
                       "bodies: [{name: b, mass: 1, shape: {point: {}}}]")
        state = properties()
        self.assertEqual((state.bodies, state.constraints), (["b"], []))
        self.assertEqual((state.time_step, state.gravity.z), (0.002, 0.0))
        self.assertEqual(state.method, "auto")

    def test_load_scene_is_all_or_nothing(self):
        self.good("load_scene", path="pendulum")
        self.bad(["path", "text"], "load_scene")
        self.bad(["path", "text"], "load_scene", path="pendulum", text="bodies: []")
        self.bad(["no_such_scene"], "load_scene", path="no_such_scene")
        self.bad(["no_such_package"], "load_scene", path="package://no_such_package/a.yaml")
        self.bad(["text:3", "mass", "-1"], "load_scene",
                 text="bodies:\n- name: a\n  mass: -1\n  shape: {point: {}}\n")
        self.bad(["text:2", "bogus"], "load_scene", text="world:\n  bogus: 1\n")

    def test_a_state_that_is_not_finite_is_never_kept(self):
        body = sphere("fast", 1e20, 0, 0)
        body.twist.linear.x = 1e20
        self.good("add_body", body=body)
        before = properties()
        answer = call("step", steps=5)
        self.assertFalse(answer.success)
        self.assertIn("failed", answer.status_message)
        self.assertEqual(properties().state_hash, before.state_hash)
        self.good("remove_body", name="fast")
        self.good("step", steps=5)


if __name__ == "__main__":
    rospy.init_node("test_services")
    rostest.rosrun("constraint_sim", "services", Services)
