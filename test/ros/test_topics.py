#!/usr/bin/env python3
"""Topics of the node: transforms, states, markers, statistics."""
import math
import unittest

import numpy
import rospy
import rostest
import tf2_ros
from constraint_sim.msg import (Body, BodyStates, Constraint, ConstraintStates, Shape,
                                Statistics)
from geometry_msgs.msg import Point, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

import support
from support import Listener, call, properties, sphere


def topic(name):
    return support.NODE + "/" + name


def stamps(messages):
    return [message.transforms[0].header.stamp for message in messages]


def points_in_world(marker):
    """Returns points of a marker, given in its own frame, in the world's frame [m]."""
    place, q = marker.pose.position, marker.pose.orientation
    axis = numpy.array((q.x, q.y, q.z))

    def turned(v):
        around = numpy.cross(axis, v)
        return v + 2 * q.w * around + 2 * numpy.cross(axis, around)
    return [turned((p.x, p.y, p.z)) + (place.x, place.y, place.z) for p in marker.points]


class Topics(unittest.TestCase):
    def setUp(self):
        call("pause_physics")
        self.assertTrue(call("load_scene", path="pendulum").success)

    def tearDown(self):
        call("pause_physics")
        Listener.stop_all()  # so that late messages do not reach the next test

    def test_each_scene_that_is_loaded_is_told(self):
        listener = Listener(topic("scene"), String)
        listener.find(lambda m: m.data == "pendulum", "the scene as it is")
        self.assertFalse(call("load_scene", path="no_such_scene").success)
        self.assertTrue(call("load_scene", text="bodies: []").success)
        self.assertTrue(call("load_scene", path="winch").success)
        listener.find(lambda m: m.data == "winch", "the last scene")
        self.assertEqual([m.data for m in listener.messages], ["pendulum", "", "winch"])

    # ---- transforms and states

    def test_tf_names_every_body_once_with_increasing_stamps(self):
        listener = Listener("/tf", TFMessage)
        listener.present(what="a transform of this scene")
        del listener.messages[:]
        call("unpause_physics")
        support.wait_until(lambda: len(listener.messages) >= 50, "50 transforms")
        call("pause_physics")
        frames = ["sim/" + name for name in properties().bodies]
        for message in listener.messages:
            self.assertEqual([t.child_frame_id for t in message.transforms], frames)
            self.assertEqual({t.header.frame_id for t in message.transforms}, {"world"})
            self.assertEqual(len({t.header.stamp for t in message.transforms}), 1)
        times = stamps(listener.messages)
        self.assertTrue(all(a < b for a, b in zip(times, times[1:])))

    def test_tf_stamps_increase_over_pause_edits_steps_and_load_scene(self):
        listener = Listener("/tf", TFMessage)
        listener.wait()
        for i in range(10):
            call("add_body", body=sphere("b%d" % i, z=5.0 + i))
            call("step", steps=3)
            call("unpause_physics")
            call("pause_physics")
            listener.wait(what="a transform after edits")
        call("load_scene", path="pendulum")
        listener.wait(what="a transform after load_scene")
        times = stamps(listener.messages)
        self.assertGreaterEqual(len(times), 12)
        self.assertTrue(all(a < b for a, b in zip(times, times[1:])))

    def test_static_bodies_are_on_tf_static_alone(self):
        support.empty_world()
        moving = Listener("/tf", TFMessage)
        call("add_body", body=sphere("ball"))
        call("add_body", body=sphere("post", 1, 2, 3, type=Body.STATIC))
        frames = lambda m: {t.child_frame_id for t in m.transforms}
        moving.wait(lambda m: frames(m) == {"sim/ball"}, "the ball")
        fixed = Listener("/tf_static", TFMessage)  # latched: earlier messages arrive too
        sent = lambda meets: next((m for m in fixed.messages if meets(m)), None)
        message = support.wait_until(lambda: sent(lambda m: frames(m) == {"sim/post"}), "the post")
        place = message.transforms[0].transform.translation
        self.assertEqual((place.x, place.y, place.z), (1, 2, 3))
        state = call("get_body_state", name="post").state
        state.pose.position.x = 5
        self.assertTrue(call("set_body_state", state=state).success)
        support.wait_until(
            lambda: sent(lambda m: m.transforms[0].transform.translation.x == 5), "its new place")
        self.assertTrue(all("sim/post" not in frames(m) for m in moving.messages))

    def test_tf_and_body_states_tell_the_same(self):
        transforms = Listener("/tf", TFMessage)
        states = Listener(topic("body_states"), BodyStates)
        call("unpause_physics")

        def shared():
            by_stamp = {m.transforms[0].header.stamp: m for m in transforms.messages}
            return [(m, by_stamp[m.header.stamp]) for m in states.messages
                    if m.header.stamp in by_stamp]
        support.wait_until(lambda: len(shared()) > 20, "transforms and states of the same rounds")
        call("pause_physics")
        for message, other in shared():
            for body, transform in zip(message.bodies, other.transforms):
                self.assertEqual("sim/" + body.name, transform.child_frame_id)
                place, moved = body.pose.position, transform.transform.translation
                self.assertEqual((place.x, place.y, place.z), (moved.x, moved.y, moved.z))
                self.assertEqual(body.pose.orientation, transform.transform.rotation)

    def test_published_states_are_those_of_the_world(self):
        states = Listener(topic("body_states"), BodyStates)
        stepped = call("step", steps=100).bodies
        message = states.wait(lambda m: m.bodies == stepped, "the state after 100 steps")
        self.assertEqual(message.header.frame_id, "world")

    def test_tf2_finds_the_bob(self):
        buffer = tf2_ros.Buffer()
        tf2_ros.TransformListener(buffer)
        start = rospy.Time.now()
        call("unpause_physics")
        bob = properties().bodies[-1]

        def found():
            if not buffer.can_transform("world", "sim/" + bob, rospy.Time(0)):
                return None
            transform = buffer.lookup_transform("world", "sim/" + bob, rospy.Time(0))
            return transform if transform.header.stamp > start else None
        transform = support.wait_until(found, "the bob's transform")
        # wall time: ahead by at most the steps that a busy machine makes up for
        self.assertLessEqual(transform.header.stamp, rospy.Time.now() + rospy.Duration(1.0))

    def test_paused_topics_repeat_each_second(self):
        states = Listener(topic("body_states"), BodyStates)
        first = states.present()
        second = states.wait()
        gap = (second.header.stamp - first.header.stamp).to_sec()
        self.assertGreater(gap, 0.0)
        self.assertEqual(first.bodies, second.bodies)

    def test_constraint_states(self):
        listener = Listener(topic("constraint_states"), ConstraintStates)
        call("load_scene", text="""
bodies:
- {name: load, mass: 2, shape: {sphere: {radius: 0.1}}}
constraints:
- {name: cable, type: distance, anchor_a: [0, 0, 3], body_b: load}
""")
        call("step", steps=100)
        state = listener.present().constraints[0]
        self.assertEqual((state.name, state.type), ("cable", "distance"))
        # a load of 2 kg at rest; -m g to rounding of a hundred warm-started steps
        self.assertAlmostEqual(state.force, -2 * 9.81, places=6)
        self.assertAlmostEqual(state.wrench.force.z, 2 * 9.81, places=6)
        self.assertEqual((state.wrench_point.x, state.wrench_point.y), (0.0, 0.0))
        self.assertLess(abs(state.error), 1e-6)
        self.assertEqual((state.closing_error, state.bias), (0.0, 0.0))
        self.assertAlmostEqual(state.position, 3.0, places=6)
        self.assertFalse(state.saturated or state.broken or state.closing)

        call("set_motor_bias", constraint="cable", bias=0.25)
        call("step", steps=10)
        state = listener.present().constraints[0]
        self.assertEqual(state.bias, 0.25)
        self.assertAlmostEqual(state.reached_rate, 0.25, places=6)

    def test_statistics(self):
        listener = Listener(topic("statistics"), Statistics)
        call("unpause_physics")
        listener.wait(lambda m: m.ticks > 0 and any(m.stage_times))
        message = listener.wait(lambda m: m.ticks > 0)
        call("pause_physics")
        self.assertEqual(message.worst_constraint, properties().constraints[0])
        self.assertLess(message.max_constraint_error, 1e-12)
        self.assertGreater(message.accumulated_local_error, 0.0)
        self.assertLess(message.local_error, 1e-8)
        self.assertTrue(0.0 < message.wall_mean <= message.wall_max)
        self.assertEqual(message.stages, ["broadphase", "narrowphase", "integration", "rows",
                                          "velocities", "solve", "positions"])
        self.assertEqual(len(message.stage_times), 7)
        self.assertLessEqual(sum(message.stage_times), message.wall_mean)
        self.assertEqual(message.methods, ["runge_kutta"])
        self.assertGreater(message.iterations, 0)
        self.assertFalse(message.failed)
        self.assertTrue(math.isfinite(message.energy) and math.isfinite(message.energy_drift))

    def test_statistics_cover_every_tick_once(self):
        listener = Listener(topic("statistics"), Statistics)
        call("unpause_physics")
        support.wait_until(lambda: len(listener.messages) >= 10, "statistics")
        call("pause_physics")
        for before, after in zip(listener.messages, listener.messages[1:]):
            self.assertEqual(after.step - before.step, after.ticks)

    def test_a_failure_is_told_and_not_published(self):
        statistics = Listener(topic("statistics"), Statistics)
        states = Listener(topic("body_states"), BodyStates)
        body = sphere("fast", 1e20)
        body.twist.linear.x = 1e20
        call("add_body", body=body)
        call("unpause_physics")
        statistics.wait(lambda m: m.failed)
        self.assertTrue(properties().paused)
        call("remove_body", name="fast")
        statistics.wait(lambda m: not m.failed and m.ticks > 0)
        for message in states.messages:
            for state in message.bodies:
                self.assertTrue(math.isfinite(state.pose.position.x))

    # ---- markers

    def shown(self, listener):
        """Returns (ns, id) -> marker after all messages so far."""
        shown = {}
        for message in listener.messages:
            for marker in message.markers:
                if marker.action == Marker.DELETEALL:
                    shown.clear()
                elif marker.action == Marker.DELETE:
                    shown.pop((marker.ns, marker.id), None)
                else:
                    shown[marker.ns, marker.id] = marker
        return shown

    def count(self, listener, ns):
        return sum(1 for key in self.shown(listener) if key[0] == ns)

    def test_markers_show_a_newcomer_all_bodies_and_constraints(self):
        listener = Listener(topic("markers"), MarkerArray)
        state = properties()
        support.wait_until(lambda: self.count(listener, "bodies") == len(state.bodies) and
                           self.count(listener, "constraints") == len(state.constraints),
                           "bodies and constraints")
        for marker in self.shown(listener).values():
            self.assertEqual(marker.header.frame_id, "world")
            self.assertGreater(marker.color.a, 0.0)

    def test_markers_of_what_is_removed_are_deleted_and_ids_never_reused(self):
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        listener.wait()
        used = set()
        for _ in range(3):
            call("add_body", body=sphere("a", 0, 0, 1))
            call("add_body", body=sphere("b", 1, 0, 1))
            call("add_distance_constraint", name="rod", body_a="a", body_b="b")
            support.wait_until(lambda: self.count(listener, "constraints") == 1, "the rod")
            support.wait_until(lambda: self.count(listener, "bodies") == 2, "the bodies")
            now = set(self.shown(listener))
            self.assertFalse(now & used)
            used |= now
            call("remove_body", name="a")
            support.wait_until(lambda: self.count(listener, "constraints") == 0, "the rod's end")
            support.wait_until(lambda: self.count(listener, "bodies") == 1, "the body's end")
            call("load_scene", text="bodies: []")
            support.wait_until(lambda: not self.shown(listener), "an empty view")

    def test_a_reset_shows_everything_anew(self):
        listener = Listener(topic("markers"), MarkerArray)
        listener.wait()
        for service in ("reset_world", "reset_simulation"):
            call("step", steps=3)
            start = len(listener.messages)
            call(service)
            renewed = support.wait_until(lambda: next(
                (m for m in listener.messages[start:]
                 if m.markers and m.markers[0].action == Marker.DELETEALL), None), service)
            self.assertEqual(sum(m.ns == "bodies" for m in renewed.markers),
                             len(properties().bodies))

    def test_markers_have_the_shapes_of_the_bodies(self):
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        call("add_body", body=sphere("ball", 0, 0, 1))
        call("add_body", body=sphere("box", 2, 0, 1, shapes=[Shape(type=Shape.BOX, dimensions=[0.1, 0.2, 0.3])]))
        call("add_body", body=sphere("floor", type=Body.STATIC, shapes=[Shape(type=Shape.PLANE)]))
        call("add_body", body=sphere("can", 5, 0, 1, shapes=[Shape(type=Shape.CYLINDER, dimensions=[0.1, 0.6])],
                                     color=ColorRGBA(1, 0.5, 0.25, 0)))
        call("add_body", body=sphere("pill", 7, 0, 1, shapes=[Shape(type=Shape.CAPSULE, dimensions=[0.1, 0.6])]))
        support.wait_until(lambda: self.count(listener, "bodies") == 5, "five bodies")
        ball, box, _, can, pill = [m for k, m in sorted(self.shown(listener).items()) if k[0] == "bodies"]
        self.assertEqual((ball.type, ball.scale.x), (Marker.SPHERE, 0.2))
        self.assertEqual((box.type, box.scale.x, box.scale.y, box.scale.z),
                         (Marker.CUBE, 0.1, 0.2, 0.3))
        self.assertEqual(box.pose.position.x, 2.0)
        self.assertEqual((can.type, can.scale.x, can.scale.y, can.scale.z),
                         (Marker.CYLINDER, 0.2, 0.2, 0.6))
        self.assertEqual(pill.type, Marker.TRIANGLE_LIST)
        self.assertAlmostEqual(max(p.z for p in pill.points), 0.4)
        self.assertAlmostEqual(max(p.x for p in pill.points), 0.1)
        self.assertEqual(can.color, ColorRGBA(1, 0.5, 0.25, 1))  # opaque where the opacity is left out
        tool = Shape(type=Shape.BOX, dimensions=[0.1, 0.2, 0.3])
        tool.pose.position.z = 0.5
        call("add_body", body=sphere("tool", 9, 0, 1, shapes=[tool], inertia=Vector3(1, 1, 1)))
        support.wait_until(lambda: self.count(listener, "bodies") == 6, "a body with a shape beside its centre")
        shown = [m for m in self.of(listener, "bodies") if m.pose.position.x == 9.0]
        self.assertEqual([m.pose.position.z for m in shown], [1.5])

    def test_constraint_lines_turn_from_green_to_red_with_the_error(self):
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        call("add_body", body=sphere("a", 0, 0, 1))
        call("add_distance_constraint", name="rod", anchor_a=Point(0, 0, 3), body_b="a")
        support.wait_until(lambda: self.count(listener, "constraints") == 1, "the rod")
        colour = [m for k, m in self.shown(listener).items() if k[0] == "constraints"][0].color
        self.assertGreater(colour.g, colour.r)
        call("add_distance_constraint", name="tight", anchor_a=Point(0, 0, 3), body_b="a",
             length=1.5)
        support.wait_until(lambda: self.count(listener, "constraints") == 2, "the other rod")
        colour = max((k[1], m) for k, m in self.shown(listener).items() if k[0] == "constraints")[1].color
        self.assertGreater(colour.r, colour.g)

    def of(self, listener, ns):
        """Returns the markers of a namespace, in the order of their ids."""
        return [m for k, m in sorted(self.shown(listener).items()) if k[0] == ns]

    def test_a_hinge_shows_its_axis(self):
        """A cylinder at the anchor along z of joint frame A shows a hinge, in body A's orientation; a ball
        joint has a ball."""
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        half = math.sqrt(0.5)  # post and its axis z are rotated by 90 degrees about x: z is -y
        post = sphere("post", 0, 0, 2, type=Body.STATIC)
        post.pose.orientation = Quaternion(half, 0, 0, half)
        call("add_body", body=post)
        call("add_body", body=sphere("door", 1, 0, 2))
        for number, kind in enumerate(("ball", "hinge"), 1):
            hinge = Constraint(name=kind, type=kind, body_a="post", body_b="door",
                               anchor_b=Point(-1, 0, 0))
            if kind == "hinge":
                hinge.axis_a = Vector3(0, 0, 1)
            self.assertTrue(call("add_constraint", constraint=hinge).success)
            support.wait_until(lambda n=number: self.count(listener, "joints") == n, kind)
        ball, hinge = self.of(listener, "joints")
        self.assertEqual((ball.type, hinge.type), (Marker.SPHERE, Marker.CYLINDER))
        self.assertGreater(hinge.scale.z, 0.1)  # [m], visible beside a body
        self.assertGreater(hinge.scale.z, 3 * hinge.scale.x)  # slender
        place, q = hinge.pose.position, hinge.pose.orientation
        self.assertEqual((place.x, place.y, place.z), (0, 0, 2))
        along = (2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x),
                 1 - 2 * (q.x * q.x + q.y * q.y))
        for found, expected in zip(along, (0, -1, 0)):
            self.assertAlmostEqual(found, expected, places=12)  # to the rounding of one rotation

    def test_the_axis_of_a_small_hinge_is_no_longer_than_its_bodies(self):
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        call("add_body", body=sphere("finger", shapes=[Shape(type=Shape.BOX, dimensions=[0.01, 0.01, 0.04])]))
        hinge = Constraint(name="hinge", type="hinge", axis_a=Vector3(0, 1, 0), body_b="finger",
                           anchor_a=Point(0, 0, 0.02), anchor_b=Point(0, 0, 0.02))
        self.assertTrue(call("add_constraint", constraint=hinge).success)
        support.wait_until(lambda: self.count(listener, "joints") == 1, "the hinge")
        marker, = self.of(listener, "joints")
        self.assertAlmostEqual(marker.scale.z, 0.04, places=12)
        self.assertLess(marker.scale.x, 0.01)  # thinner than the rod

    def load_kinds(self, *constraints):
        """Loads a ball a metre below each of these constraints, which hang at z = 2."""
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        bodies = "".join("- {name: b%d, mass: 2, shape: {sphere: {radius: 0.1}}, "
                         "position: [%d, 0, 1]}\n" % (i, i) for i in range(len(constraints)))
        joints = "".join("- {name: c%d, anchor_a: [%d, 0, 2], body_b: b%d, %s}\n" % (i, i, i, c)
                         for i, c in enumerate(constraints))
        answer = call("load_scene", text="bodies:\n%sconstraints:\n%s" % (bodies, joints))
        self.assertTrue(answer.success, answer.status_message)
        support.wait_until(lambda: self.count(listener, "constraints") == len(constraints), "them")
        return listener

    def test_kinds_of_distance_constraints_look_different(self):
        listener = self.load_kinds("type: distance", "type: rope, max_length: 1",
                                   "type: rope, max_length: 1.5",
                                   "type: spring, length: 0.5, stiffness: 40",
                                   "type: strut, min_length: 1")
        call("step", steps=2)
        # a slack rope sags by sqrt(3/16 (1.5² - z²)) in its middle, z the distance
        support.wait_until(lambda: self.of(listener, "constraints")[1].color.b > 0.5, "tension")
        rod, taut, slack, spring, strut = self.of(listener, "constraints")
        self.assertEqual(rod.type, Marker.CYLINDER)
        self.assertAlmostEqual(rod.scale.z, 1.0, places=6)
        taut_points, slack_points, coil = map(points_in_world, (taut, slack, spring))
        self.assertEqual(len(taut_points), len(slack_points))
        self.assertEqual(len({(c.r, c.g, c.b) for c in taut.colors}), 2)  # striped
        middle = lambda points: points[len(points) // 2]
        self.assertAlmostEqual(middle(taut_points)[2], 1.5, places=5)
        length = 2.0 - min(slack_points[0][2], slack_points[-1][2])
        sag = math.sqrt(3 / 16 * (1.5 ** 2 - length ** 2))
        self.assertAlmostEqual(middle(slack_points)[2], 2.0 - length / 2 - sag, places=6)
        self.assertGreater(len(coil), 100)
        around = {round(math.hypot(x - 3, y), 6) for x, y, _ in coil}
        self.assertEqual(len(around), 2)  # on the axis, and on the coil
        self.assertNotEqual(len(strut.points), len(spring.points))

    def test_springs_are_never_red(self):
        listener = self.load_kinds("type: spring, length: 0.1, stiffness: 1")
        colour = self.of(listener, "constraints")[0].color
        self.assertGreater(colour.g, colour.r)

    def test_tension_is_cyan_and_compression_yellow(self):
        listener = self.load_kinds("type: distance")
        call("add_body", body=sphere("top", 5, 0, 2))
        call("add_distance_constraint", name="prop", anchor_a=Point(5, 0, 1), body_b="top")
        call("step", steps=2)
        support.wait_until(lambda: self.count(listener, "constraints") == 2, "the prop")

        def are_told():
            hanging, prop = [m.color for m in self.of(listener, "constraints")]
            return hanging.b > 0.7 and hanging.r < 0.3 and prop.r > 0.7 and prop.b < 0.3
        support.wait_until(are_told, "cyan and yellow")

    def test_motors_have_arrows_along_their_direction(self):
        listener = self.load_kinds("type: distance, motor: {bias: 0.1}",
                                   "type: distance, motor: {bias: -0.1}", "type: distance")
        call("step", steps=2)
        support.wait_until(lambda: self.count(listener, "motors") == 2, "motors")
        apart, together = self.of(listener, "motors")
        for marker, sign in ((apart, 1), (together, -1)):
            start, end = points_in_world(marker)[:2]  # shaft of the upper arrow
            self.assertGreater(sign * (end[2] - start[2]), 0.05)

    def test_what_breaks_is_grey_for_two_seconds(self):
        listener = self.load_kinds("type: distance, break_force: 10", "type: distance")
        self.assertTrue(call("add_body", body=sphere("late", 9, 0, 0)).success)
        call("unpause_physics")
        broken = self.of(listener, "constraints")[0].id

        def stamps(fits):
            return [marker.header.stamp.to_sec() for message in list(listener.messages)
                    for marker in message.markers
                    if (marker.ns, marker.id) == ("constraints", broken) and fits(marker)]
        ends = support.wait_until(lambda: stamps(lambda m: m.action == Marker.DELETE), "the end")
        call("pause_physics")
        grey = stamps(lambda m: m.action == Marker.ADD and m.color.r == m.color.g == m.color.b)
        # by stamps, however late messages arrive; 1e-6 s is the rounding of their differences
        self.assertGreater(ends[0] - grey[0], 2.0 - 1e-6)
        self.assertLess(grey[-1] - grey[0], 2.0 + 1e-6)

    def test_bodies_have_their_own_colours_and_static_ones_are_muted(self):
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        call("load_scene", text="""
bodies:
- {name: red, mass: 1, color: [1, 0.25, 0, 0.5]}
- {name: wall, type: static, shape: {box: {size: [1, 1, 1]}}, position: [3, 0, 0]}
""")
        support.wait_until(lambda: self.count(listener, "bodies") == 2, "both")
        red, wall = [m.color for m in self.of(listener, "bodies")]
        self.assertEqual((red.r, red.g, red.b, red.a), (1, 0.25, 0, 0.5))
        self.assertLess(max(wall.r, wall.g, wall.b), 0.4)
        text = call("save_scene").text
        self.assertIn("color: [1, 0.25, 0, 0.5]", text)

    def test_contact_arrows_come_out_of_the_floor(self):
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        call("add_body", body=sphere("floor", type=Body.STATIC, shapes=[Shape(type=Shape.PLANE)]))
        call("add_body", body=sphere("ball", z=0.1))
        call("add_body", body=sphere("heavy", x=1, z=0.1, mass=4.0))
        call("step", steps=20)

        def shafts():
            points = [p for m in self.of(listener, "contacts") for p in m.points]
            return sorted(b.z - a.z for a, b in zip(points[::2], points[1::2])
                          if a.x == b.x and a.y == b.y)
        # proportional to their weights at rest; the message of the last step comes after earlier ones
        support.wait_until(lambda: len(shafts()) == 2 and shafts()[0] > 0.0 and
                           abs(shafts()[1] / shafts()[0] - 4.0) < 1e-3, "arrows as long as 1 to 4")

    def test_labels_say_names_forces_and_rates(self):
        self.load_kinds("type: distance, motor: {bias: 0.1}", "type: rope, max_length: 1.5")
        listener = Listener(topic("labels"), MarkerArray)
        call("step", steps=2)
        text = lambda ns: [m.text.strip() for m in self.of(listener, ns)]  # spaces place it beside its line
        support.wait_until(lambda: text("forces")[:1] == ["19.6 N"], "the force")
        self.assertEqual(text("forces")[1], "slack rope")
        self.assertEqual(text("body_names"), ["b0", "b1"])
        self.assertEqual(text("constraint_names"), ["c0", "c1"])
        self.assertEqual(text("motor_rates"), ["extends 0.1 m/s"])
        self.assertEqual(text("errors"), [])
        self.assertTrue(any("tension" in line for line in text("legend")))
        call("add_distance_constraint", name="off", anchor_a=Point(0, 0, 2), body_b="b0", length=2)
        support.wait_until(lambda: text("errors"), "the error")
        self.assertEqual(text("errors"), ["off by 1 m, closing"])

    def test_the_legend_has_forces_of_the_scene_that_is_loaded(self):
        self.load_kinds("type: distance")
        listener = Listener(topic("labels"), MarkerArray)
        call("step", steps=2)
        told = lambda: any("tension" in m.text for m in self.of(listener, "legend"))
        support.wait_until(told, "the tension")
        slack = ("bodies: [{name: b0, mass: 2, shape: {sphere: {radius: 0.1}}, position: [0, 0, 1]}]\n"
                 "constraints: [{name: c0, anchor_a: [0, 0, 2], body_b: b0, type: rope, max_length: 1.5}]")
        self.assertTrue(call("load_scene", text=slack).success)
        call("step", steps=2)
        support.wait_until(lambda: not told(), "a legend without it")

    def test_contacts_appear_and_go(self):
        support.empty_world()
        listener = Listener(topic("markers"), MarkerArray)
        call("add_body", body=sphere("floor", type=Body.STATIC, shapes=[Shape(type=Shape.PLANE)]))
        call("add_body", body=sphere("ball", z=0.1))
        call("step", steps=20)
        support.wait_until(lambda: self.count(listener, "contacts") == 1, "the contact")
        call("remove_body", name="floor")
        support.wait_until(lambda: self.count(listener, "contacts") == 0, "the contact's end")


if __name__ == "__main__":
    rospy.init_node("test_topics")
    rostest.rosrun("constraint_sim", "topics", Topics)
