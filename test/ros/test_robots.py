#!/usr/bin/env python3
"""Robots from URDFs: load_urdf, frames beside a robot_state_publisher, and command topics."""
import contextlib
import os
import subprocess
import tempfile

import genpy.dynamic
import numpy
import rospkg
import rospy
import rostest
from constraint_sim.msg import Body, Shape
from geometry_msgs.msg import Pose, Twist, Vector3, Wrench, WrenchStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

import support
from support import Listener, call, node_command, properties, running, wait_until

ROBOTS = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "config", "robots")
POSE = """
positions: {shoulder_pan: 0.3, shoulder_lift: -0.4, elbow: 0.9, wrist_1: -0.5, wrist_2: 0.4, wrist_3: 1.1}
links: {base_link: {no_collision: true}, upper_arm: {no_collision: true}, forearm: {no_collision: true}}
"""
MOTORS = """
motors: {shoulder_pan: {bias: 0, max_force: 0}, shoulder_lift: {bias: 0, max_force: 0}, elbow: {bias: 0, max_force: 0}}
"""
LINKS = ["base_link", "shoulder", "upper_arm", "forearm", "wrist_1_link", "wrist_2_link",
         "wrist_3_link", "flange", "tool0"]


def urdf(name):
    with open(os.path.join(ROBOTS, name + ".urdf")) as file:
        return file.read()


@contextlib.contextmanager
def simulator(**parameters):
    """Starts a paused node with these parameters, and waits until it responds."""
    with running(node_command(paused=True, **parameters)) as process:
        properties()
        yield process


@contextlib.contextmanager
def robot_state_publisher(robot, topic):
    rospy.set_param("/robot_description", urdf(robot))
    program = subprocess.check_output(
        ["catkin_find", "--first-only", "--libexec", "robot_state_publisher",
         "robot_state_publisher"], universal_newlines=True).strip()
    with running([program, "joint_states:=%s/joint_states" % support.NODE, "/tf:=" + topic,
                  "/tf_static:=%s_static" % topic, "__name:=robot_state_publisher"]):
        yield


def matrix(transform):
    t, q = transform.translation, transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t.x],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t.y],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t.z],
        [0, 0, 0, 1]])


class Robots(support.ServiceCase):
    def tearDown(self):
        Listener.stop_all()

    def step_until(self, seen):
        """Steps tick by tick until the responses of step show the condition: no response tells that a message has
        arrived. Returns the states of the last two steps, by name."""
        states = [{body.name: body for body in self.good("step", steps=0).bodies}]

        def is_seen():
            states.append({body.name: body for body in self.good("step", steps=1).bodies})
            return seen(states[-2], states[-1])
        wait_until(is_seen, "what the message does")
        return states[-2:]

    def expect(self, listener, joint, value, field="position"):
        """Waits until a joint of a paused world has this value, within integration errors."""
        def reads():
            message = listener.messages[-1] if listener.messages else None
            if not message or joint not in message.name:
                return False
            return abs(getattr(message, field)[message.name.index(joint)] - value) < 1e-9
        wait_until(reads, "%s of %s to be %.12g" % (field, joint, value))

    def test_frames_agree_with_a_robot_state_publisher(self):
        ours, fixed = Listener("/tf", TFMessage), Listener("/arm/tf_static", TFMessage)
        theirs = Listener("/arm/tf", TFMessage)
        with simulator(), robot_state_publisher("arm", "/arm/tf"):
            answer = self.good("load_urdf", path="arm", fixed=True, extra=POSE)
            self.assertEqual(len(answer.bodies), 7)
            self.assertEqual(answer.constraints, ["shoulder_pan", "shoulder_lift", "elbow",
                                                  "wrist_1", "wrist_2", "wrist_3"])
            call("unpause_physics")
            rest = wait_until(lambda: fixed.messages and fixed.messages[-1], "fixed frames")

            def compared():
                mine = {m.transforms[0].header.stamp: m for m in ours.messages if m.transforms}
                return [(mine[m.transforms[0].header.stamp], m) for m in theirs.messages
                        if m.transforms and m.transforms[0].header.stamp in mine]
            wait_until(lambda: len(compared()) >= 20, "20 rounds with the same stamp")
            most, moved = 0.0, 0.0
            for mine, other in compared():
                parents = {t.child_frame_id: (t.header.frame_id, matrix(t.transform))
                           for t in list(other.transforms) + list(rest.transforms)}
                frames = {t.child_frame_id: matrix(t.transform) for t in mine.transforms}
                self.assertEqual(sorted(frames), sorted(LINKS))
                for link in LINKS[1:]:
                    chain, at = numpy.eye(4), link
                    while at != "base_link":
                        at, transform = parents[at]
                        chain = transform @ chain
                    difference = numpy.abs(frames["base_link"] @ chain - frames[link]).max()
                    most = max(most, difference)
                moved = max(moved, numpy.abs(frames["tool0"] - chain_start(compared)).max())
            self.assertLess(most, 1e-9)
            self.assertGreater(moved, 0.01)

    def test_nothing_is_published_twice(self):
        with simulator(publish_links="root"), robot_state_publisher("arm", "/tf"):
            tf = Listener("/tf", TFMessage)
            static = Listener("/tf_static", TFMessage)
            self.good("load_urdf", path="arm", fixed=True, extra=POSE)
            call("unpause_physics")

            def publishers():
                found = {}
                for message in tf.messages + static.messages:
                    for transform in message.transforms:
                        found.setdefault(transform.child_frame_id, set()).add(
                            message._connection_header["callerid"])
                return found
            wait_until(lambda: sorted(publishers()) == sorted(LINKS), "frames of all links")
            self.assertEqual({link: 1 for link in LINKS},
                             {link: len(callers) for link, callers in publishers().items()})
            self.assertEqual(publishers()["base_link"], {support.NODE})

    def test_two_robots_with_a_robot_state_publisher_each(self):
        """In the robot's namespace a robot_state_publisher needs no settings, whatever the prefix."""
        program = subprocess.check_output(
            ["catkin_find", "--first-only", "--libexec", "robot_state_publisher",
             "robot_state_publisher"], universal_newlines=True).strip()
        ours, theirs, fixed = (Listener(topic, TFMessage)
                               for topic in ("/tf", "/robots/tf", "/robots/tf_static"))
        robots = {"left": "left/", "right_": "right_"}
        with contextlib.ExitStack() as stack:
            stack.enter_context(simulator(frame_prefix="sim/"))
            for i, (name, prefix) in enumerate(robots.items()):
                self.good("load_urdf", path="arm", fixed=True, prefix=prefix, extra=POSE,
                          pose=above(2.0 * i))
                space = "%s/robots/%s" % (support.NODE, name)
                wait_until(lambda: rospy.has_param(space + "/robot_description"), space)
                stack.enter_context(running(
                    [program, "__ns:=" + space, "/tf:=/robots/tf", "/tf_static:=/robots/tf_static",
                     "__name:=robot_state_publisher"]))
                states = Listener(space + "/joint_states", JointState).wait()
                self.assertEqual(states.name, [prefix + joint for joint in (
                    "shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")])

            def frames(listeners):
                return {t.child_frame_id: t for listener in listeners for m in listener.messages
                        for t in m.transforms}
            links = ["sim/" + prefix + link for prefix in robots.values() for link in LINKS]
            wait_until(lambda: set(links) <= set(frames([ours])), "our frames")
            wait_until(lambda: {link for link in links if not link.endswith("base_link")} ==
                       set(frames([theirs, fixed])), "their frames")
            mine, other = frames([ours]), frames([theirs, fixed])  # the world is paused
            for link in links:
                if link.endswith("base_link"):
                    continue
                at, chain = link, numpy.eye(4)
                while at in other:
                    chain = matrix(other[at].transform) @ chain
                    at = other[at].header.frame_id
                difference = matrix(mine[at].transform) @ chain - matrix(mine[link].transform)
                self.assertLess(numpy.abs(difference).max(), 1e-9)  # as of one robot
            for body in properties().bodies:
                if body.startswith("left/"):
                    self.good("remove_body", name=body)
            wait_until(lambda: not rospy.has_param(support.NODE + "/robots/left"), "no parameter")
            self.assertTrue(rospy.has_param(support.NODE + "/robots/right_/robot_description"))
            # the action of a removed robot stays until its results are sent
            wait_until(lambda: not any("/left/" in topic for topic, _ in rospy.get_published_topics(
                support.NODE + "/robots")), "no topic of left")
            topics = {topic for topic, _ in rospy.get_published_topics(support.NODE + "/robots")}
            action = "follow_joint_trajectory/"
            self.assertEqual(topics, {support.NODE + "/robots/right_/" + topic for topic in (
                "joint_states", "plot", action + "status", action + "feedback", action + "result")})
        self.assertFalse(rospy.has_param(support.NODE + "/robots"))

    def test_plots_have_a_field_for_each_joint(self):
        """Names of curves are those of fields, for programs that know a message by its definition alone."""
        with simulator():
            self.good("load_urdf", path="arm", fixed=True, prefix="left/", extra=POSE + MOTORS)
            space = support.NODE + "/robots/left/"
            plots = Listener(space + "plot", rospy.AnyMsg)
            states = Listener(space + "joint_states", JointState)
            call("unpause_physics")

            header = plots.find(what="a plot")._connection_header
            made = genpy.dynamic.generate_dynamic(header["type"], header["message_definition"])[header["type"]]
            self.assertEqual(made._md5sum, header["md5sum"])

            def same():
                """Returns a plot and joint states with the same stamp, once there are both after 0.1 s of motion."""
                stamps = {message.header.stamp: message for message in list(states.messages)[5:]}
                for plot in list(plots.messages):
                    message = made().deserialize(plot._buff)
                    if message.header.stamp in stamps:
                        return message, stamps[message.header.stamp]
                return None
            message, state = wait_until(same, "a plot and joint states of a time")
        fields = ["left_" + joint for joint in (
            "shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
        self.assertEqual(message.__slots__, ["header"] + fields)
        self.assertEqual([field.replace("left_", "left/") for field in fields], state.name)
        for field, position, velocity, effort in zip(fields, state.position, state.velocity,
                                                     state.effort):
            reading = getattr(message, field)
            self.assertEqual((reading.position, reading.velocity, reading.effort),
                             (position, velocity, effort))
            self.assertLess(abs(reading.error), 1e-9)  # joints are held to rounding
        self.assertNotEqual(max(map(abs, state.velocity)), 0.0)
        self.assertNotEqual(max(map(abs, state.effort)), 0.0)

    def test_plots_lose_the_fields_of_removed_joints(self):
        """The type of the topic changes, also for those who listen meanwhile."""
        with simulator():
            self.good("load_urdf", path="gripper", fixed=True)
            plots = Listener(support.NODE + "/robots/gripper/plot", rospy.AnyMsg)

            def fields_of(plot):
                header = plot._connection_header
                lines = header["message_definition"].split("=" * 80)[0].splitlines()
                return [line.split()[1] for line in lines if line.startswith("constraint_sim/JointReading ")]
            before = fields_of(plots.find(what="a plot"))
            self.assertGreater(len(before), 1)
            self.good("remove_constraint", name=before[-1])
            after = fields_of(plots.find(lambda plot: len(fields_of(plot)) < len(before), "a plot of another type"))
            self.assertEqual(after, before[:-1])

    def test_joints_that_move_no_mass_are_named_and_stand_in_joint_states(self):
        """robot_state_publisher needs the positions of all joints that its URDF does not call fixed."""
        mass = ("<inertial><mass value='1'/><inertia ixx='0.1' ixy='0' ixz='0' iyy='0.1' iyz='0' izz='0.1'/>"
                "</inertial>")
        text = ("<robot name='r'><link name='base'>" + mass + "</link><link name='cross'/><link name='foot'>" + mass +
                "</link><link name='tool0'/>" + "".join(
                    "<joint name='%s' type='continuous'><parent link='%s'/><child link='%s'/><axis xyz='%s'/></joint>"
                    % joint for joint in (("pitch", "base", "cross", "0 1 0"), ("roll", "cross", "foot", "1 0 0"),
                                          ("turn", "foot", "tool0", "0 0 1"))) + "</robot>")
        with simulator():
            answer = call("load_urdf", text=text, prefix="left/", extra="positions: {turn: 0.5}")
            self.assertTrue(answer.success, answer.status_message)
            self.assertIn("joints that move no mass are fixed", answer.status_message)
            self.assertIn("'turn' at 0.5 (link 'tool0')", answer.status_message)
            self.assertIn("'cross' 0.0001 kg", answer.status_message)
            self.assertEqual(answer.constraints, ["left/pitch", "left/roll"])
            for topic in ("/joint_states", "/robots/left/joint_states"):
                state = rospy.wait_for_message(support.NODE + topic, JointState, timeout=20)
                self.assertEqual(dict(zip(state.name, state.position)),
                                 {"left/pitch": 0.0, "left/roll": 0.0, "left/turn": 0.5})
                self.assertEqual(len(state.velocity), 3)
                self.assertEqual(len(state.effort), 3)

    def test_frames_of_bodies_are_children_of_links(self):
        with simulator(publish_com=True, robot="gripper", robot_fixed=True):
            tf = Listener("/tf", TFMessage)
            message = tf.wait()
            parents = {t.child_frame_id: t.header.frame_id for t in message.transforms}
            self.assertEqual(parents["left_finger"], "world")
            self.assertEqual(parents["left_finger/com"], "left_finger")

    def test_bad_descriptions_change_nothing(self):
        with simulator():
            before = properties().state_hash
            for part, fields in (("exactly one", {}),
                                 ("exactly one", {"path": "arm", "text": urdf("arm")}),
                                 ("cannot read", {"path": "/nowhere.urdf"}),
                                 ("a mass >= 0", {"text": urdf("arm").replace('mass value="8.4"',
                                                                              'mass value="-8"')}),
                                 ("no mesh 'package://nowhere/a.stl'",
                                  {"text": urdf("arm").replace(
                                      '<sphere radius="0.05"/>',
                                      '<mesh filename="package://nowhere/a.stl"/>')}),
                                 ("no joint 'knee'", {"path": "arm", "extra": "positions: {knee: 1}"}),
                                 ("orientation", {"path": "arm", "pose": quarter()})):
                answer = call("load_urdf", **fields)
                self.assertFalse(answer.success, part)
                self.assertIn(part, answer.status_message)
                self.assertEqual(properties().state_hash, before)
            self.good("load_urdf", path="arm", prefix="left/")
            self.good("load_urdf", path="arm", prefix="right/")
            before = properties().state_hash
            answer = call("load_urdf", path="arm", prefix="left/")
            self.assertIn("left/base_link/com", answer.status_message)
            self.assertEqual(properties().state_hash, before)

    def test_xacro_that_was_not_run_is_named_and_its_command_is_told(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "arm.urdf.xacro")
            for part, text in (
                    ("<xacro:gripper> (line ", urdf("arm").replace(
                        "</robot>", "<xacro:gripper parent='tool0'/></robot>")),
                    ("<xacro:include> (line ", urdf("arm").replace(
                        "</robot>", "<xacro:include filename='hand.xacro'/></robot>")),
                    ("${radius} (line ", urdf("arm").replace('radius="0.05"', 'radius="${radius}"')),
                    ("$(find arm) (line ", urdf("arm").replace(
                        '<sphere radius="0.05"/>', '<mesh filename="$(find arm)/a.stl"/>'))):
                self.assertNotEqual(text, urdf("arm"), part)
                with open(path, "w") as file:
                    file.write(text)
                with simulator():
                    before = properties().state_hash
                    answer = call("load_urdf", text=text)
                    self.assertFalse(answer.success, part)
                    for word in ("xacro has not been run", part, "program xacro"):
                        self.assertIn(word, answer.status_message)
                    self.assertEqual(properties().state_hash, before)
            program = os.path.join(folder, "xacro")
            with open(program, "w") as file:
                file.write("#!/bin/sh\n")
            os.chmod(program, 0o755)
            environment = dict(os.environ, PATH=folder + ":" + os.environ["PATH"])
            with running(node_command(paused=True), env=environment):
                answer = call("load_urdf", path=path)
                self.assertFalse(answer.success)
                self.assertIn("`xacro '%s' > expanded.urdf` expands it" % path, answer.status_message)

    def test_definitions_that_are_left_of_xacro_are_named(self):
        text = urdf("arm").replace("</robot>", "<xacro:property name='width' value='0.1'/>"
                                   "<xacro:macro name='leg'><link name='${n}'/></xacro:macro></robot>")
        with simulator():
            answer = self.good("load_urdf", text=text)
            for word in ("definitions of xacro", "<xacro:property> (line ", "<xacro:macro> (line "):
                self.assertIn(word, answer.status_message)

    def test_a_bad_robot_in_a_parameter_ends_the_node(self):
        with running(node_command(robot="nobody")) as process:
            self.assertEqual(process.wait(support.TIMEOUT), 2)

    def test_robots_that_are_gone_are_forgotten_after_many_others(self):
        visual = '<visual><geometry><mesh filename="file:///etc/hostname"/></geometry></visual>'
        text = urdf("arm").replace("</link>", 3000 * visual + "</link>", 1)
        with simulator() as process:
            def replace(times):
                for _ in range(times):
                    self.good("load_urdf", text=text)
                    self.good("load_scene", text="bodies: []")
            replace(15)
            before = support.memory_of(process)
            replace(40)  # its visuals are some 60 MiB
            self.assertLess(support.memory_of(process) - before, 20.0)

    def test_the_parameter_robot_description(self):
        rospy.set_param("/robot_description", urdf("quadruped"))
        with simulator(robot="/robot_description", robot_z=0.5):
            self.assertEqual(len(properties().bodies), 13)
            markers = Listener(support.NODE + "/markers", MarkerArray)
            message = markers.wait(lambda m: any(x.ns == "visuals" for x in m.markers))
            visuals = [m for m in message.markers if m.ns == "visuals"]
            self.assertEqual(len(visuals), 17)
            self.assertEqual({m.type for m in visuals},
                             {Marker.CUBE, Marker.CYLINDER, Marker.SPHERE})
            loaded = len(markers.messages)
            call("load_scene", text="bodies: []")
            # the first message of the new scene starts with DELETEALL
            anew = markers.find(lambda m: m.markers and m.markers[0].action == Marker.DELETEALL,
                                "the markers of the new scene", loaded)
            self.assertEqual([m.ns for m in anew.markers if m.ns == "visuals"], [])

    def test_a_trajectory_is_followed(self):
        with simulator(real_time_factor=0):
            self.good("load_urdf", path="arm", fixed=True, extra=POSE + MOTORS)
            states = Listener(support.NODE + "/joint_states", JointState)
            topic = rospy.Publisher(support.NODE + "/joint_trajectory", JointTrajectory,
                                    queue_size=1)
            wait_until(topic.get_num_connections, "the simulator")
            end = JointTrajectoryPoint(positions=[0.5, 0.2], velocities=[0, 0],
                                       accelerations=[0, 0], time_from_start=rospy.Duration(1))
            topic.publish(JointTrajectory(joint_names=["shoulder_pan", "elbow"], points=[end]))
            # the first tick rotates it by 2e-6 rad; motors hold the others to rounding
            turned = lambda a, b: max(abs(getattr(a, i) - getattr(b, i)) for i in "xyzw") > 1e-8
            self.step_until(lambda before, after: turned(
                before["shoulder/com"].pose.orientation, after["shoulder/com"].pose.orientation))
            self.good("step", steps=49)
            # a quintic is half way in the middle
            self.expect(states, "shoulder_pan", 0.5 * (0.3 + 0.5))
            self.expect(states, "elbow", 0.5 * (0.9 + 0.2))
            self.good("step", steps=60)
            self.expect(states, "shoulder_pan", 0.5)
            self.expect(states, "elbow", 0.2)
            self.expect(states, "shoulder_lift", -0.4)

    def test_what_drives_ends_with_the_world_that_it_was_for(self):
        """A restored world, also of another process whose joints have equal numbers, ends drives of the previous
        one."""
        other = """
bodies:
  - {name: a, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}}
  - {name: b, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}, position: [0, 5, 0]}
world: {gravity: [0, 0, 0]}
constraints:
%s
""" % "\n".join("  - {name: hinge_%d, type: hinge, body_b: %s, anchor_a: [0, %d, %d], motor: {bias: 0}}"
                % (i, "ab"[i], 5 * i, 0) for i in range(2))
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "other.snapshot")
            with simulator(scene_folder=folder):
                self.good("load_scene", text=other)
                self.good("save_snapshot", path="other.snapshot")
            with simulator(cmd_vel="cart", wrench="ball"):
                self.good("load_urdf", path="arm", fixed=True, extra=POSE + MOTORS)
                cart = Body(name="cart", type=Body.KINEMATIC,
                            shapes=[Shape(type=Shape.BOX, dimensions=[1, 1, 1])])
                cart.pose.position.y = 9
                self.good("add_body", body=cart)
                self.good("add_body", body=support.sphere("ball", y=-9.0))
                self.good("save_snapshot", name="before")
                topics = [rospy.Publisher(support.NODE + name, kind, queue_size=1)
                          for name, kind in (("/joint_trajectory", JointTrajectory),
                                             ("/cmd_vel/cart", Twist),
                                             ("/wrench/ball", WrenchStamped))]
                log = Listener("/rosout", Log)
                for topic in topics:
                    wait_until(topic.get_num_connections, topic.name)

                def drive():
                    end = JointTrajectoryPoint(positions=[0.5, 0.2],
                                               time_from_start=rospy.Duration(100))
                    topics[0].publish(JointTrajectory(joint_names=["shoulder_pan", "elbow"],
                                                      points=[end]))
                    topics[1].publish(Twist(linear=Vector3(0.5, 0, 0)))
                    topics[2].publish(WrenchStamped(wrench=Wrench(force=Vector3(2, 0, 0))))
                    self.step_until(lambda before, after: all(
                        before[body].pose != after[body].pose for body in ("shoulder/com", "cart", "ball")))

                def ended(by):
                    for topic, names in (("joint_trajectory", ["shoulder_pan", "elbow"]),
                                         ("cmd_vel", ["cart"]), ("wrench", ["ball"])):
                        wait_until(lambda: any(
                            m.msg.startswith("%s: ended by %s: " % (topic, by)) and
                            all(name in m.msg for name in names) for m in log.messages), by)
                    log.messages.clear()

                drive()
                self.good("restore_snapshot", name="before")
                ended("restore_snapshot")
                alone = self.good("step", steps=50).state_hash
                self.good("restore_snapshot", name="before")
                self.assertEqual(self.good("step", steps=50).state_hash, alone)
                self.assertEqual(call("get_body_state", name="cart").state.pose.position.x, 0.0)

                drive()
                restored = self.good("restore_snapshot", path=file)
                ended("restore_snapshot")
                frames = Listener("/tf", TFMessage)
                self.good("step", steps=50)
                at_rest = [call("get_body_state", name=name).state.twist.angular for name in "ab"]
                self.assertEqual([(w.x, w.y, w.z) for w in at_rest], [(0, 0, 0)] * 2)
                self.assertEqual(restored.step, 0)
                message = frames.wait()  # transforms of these bodies, and not of links with their numbers
                self.assertEqual({t.child_frame_id for t in message.transforms}, {"a", "b"})

                # the robot returns with its world, and so do its frames
                self.good("restore_snapshot", name="before")
                self.good("step", steps=1)
                frames.wait(lambda m: set(LINKS) - {"base_link"} <=
                            {t.child_frame_id for t in m.transforms})
                drive()
                self.good("load_scene", text="bodies: []")
                ended("load_scene")

    def test_commands_by_what_motor_there_is(self):
        motors = """
motors:
  shoulder_pan: {bias: 0, max_force: 0}
  elbow: {position: 0.9, max_force: 0}
  wrist_3: {force: 0}
"""
        with simulator(command="shoulder_pan elbow wrist_3 wrist_1"):
            self.good("load_urdf", text=urdf("arm").replace('damping="0.02"', 'damping="0"'),
                      fixed=True, extra=POSE + motors)
            states = Listener(support.NODE + "/joint_states", JointState)
            for joint, value in (("shoulder_pan", 0.2), ("elbow", 0.7), ("wrist_3", 0.01)):
                topic = rospy.Publisher("%s/command/%s" % (support.NODE, joint), Float64,
                                        queue_size=1)
                wait_until(topic.get_num_connections, joint)
                before = properties().state_hash
                topic.publish(value)
                wait_until(lambda: properties().state_hash != before, "the command of " + joint)
            self.good("step", steps=100)
            self.expect(states, "shoulder_pan", 0.3 + 0.2)
            self.expect(states, "elbow", 0.7)
            self.expect(states, "wrist_3", 0.01, "effort")

    def test_a_command_after_a_trajectory_means_what_it_did_before(self):
        motors = "motors: {shoulder_pan: {position: 0.3, max_force: 0}, elbow: {bias: 0, max_force: 0}}"
        with simulator(command="shoulder_pan"):
            self.good("load_urdf", path="arm", fixed=True, extra=POSE + motors)
            states = Listener(support.NODE + "/joint_states", JointState)
            follow = rospy.Publisher(support.NODE + "/joint_trajectory", JointTrajectory, queue_size=1)
            command = rospy.Publisher(support.NODE + "/command/shoulder_pan", Float64, queue_size=1)
            for topic in (follow, command):
                wait_until(topic.get_num_connections, topic.name)

            def move():
                end = JointTrajectoryPoint(positions=[0.5, 0.2], velocities=[0, 0],
                                           time_from_start=rospy.Duration(1.0))
                follow.publish(JointTrajectory(joint_names=["shoulder_pan", "elbow"], points=[end]))
                self.step_until(lambda before, after: abs(after["forearm/com"].twist.angular.z) > 0.01)

            def go(position):
                before = properties().state_hash
                command.publish(position)
                wait_until(lambda: properties().state_hash != before, "the command")
                self.good("step", steps=200)  # longer than the closing time of 0.5 s
                self.expect(states, "shoulder_pan", position)
            move()
            self.good("step", steps=200)
            self.expect(states, "shoulder_pan", 0.5)
            go(0.7)
            move()
            go(0.1)  # in the middle of a trajectory
            self.assertIn("position: 0.1", self.good("save_scene").text)

    def test_odometry_wrenches_and_twists(self):
        with simulator(odometry="ball left/trunk", wrench="ball", cmd_vel="cart"):
            self.good("load_scene", text="world: {gravity: [0, 0, 0]}")
            self.good("add_body", body=support.sphere("ball"))
            cart = Body(name="cart", type=Body.KINEMATIC,
                        shapes=[Shape(type=Shape.BOX, dimensions=[1, 1, 1])])
            cart.pose.position.y = 5
            cart.pose.orientation.z = cart.pose.orientation.w = 0.5 ** 0.5
            self.good("add_body", body=cart)
            self.good("load_urdf", path="quadruped", prefix="left/", extra="{}",
                      pose=above(3.0))
            wrench = rospy.Publisher(support.NODE + "/wrench/ball", WrenchStamped, queue_size=1)
            twist = rospy.Publisher(support.NODE + "/cmd_vel/cart", Twist, queue_size=1)
            for topic in (wrench, twist):
                wait_until(topic.get_num_connections, topic.name)
            push, drive = WrenchStamped(), Twist()
            push.wrench.force.x = 2.0
            drive.linear.x = 0.5
            wrench.publish(push)
            self.step_until(lambda before, after: after["ball"].twist.linear.x > 0.0)
            self.good("step", steps=99)
            # 2 N on 1 kg for 1 s; nobody subscribed before
            odometry = Listener(support.NODE + "/odometry/ball", Odometry).present()
            self.assertAlmostEqual(odometry.twist.twist.linear.x, 2.0, delta=1e-9)
            self.assertAlmostEqual(odometry.pose.pose.position.x, 1.0, delta=1e-9)
            self.assertEqual(odometry.child_frame_id, "ball")
            twist.publish(drive)
            before, _ = self.step_until(lambda before, after: after["cart"].twist.linear.y > 0.0)
            self.good("step", steps=99)
            # forwards is along y, since it is rotated by a quarter turn
            position = call("get_body_state", name="cart").state.pose.position
            self.assertAlmostEqual(position.y - before["cart"].pose.position.y, 0.5, delta=1e-9)
            self.assertAlmostEqual(position.x, 0.0, delta=1e-9)
            trunk = Listener(support.NODE + "/odometry/left/trunk", Odometry).present()
            self.assertAlmostEqual(trunk.pose.pose.position.z, 3.0, delta=1e-9)


def chain_start(compared):
    """Returns the initial position of tool0."""
    return matrix(next(t.transform for t in compared()[0][0].transforms
                       if t.child_frame_id == "tool0"))


def quarter():
    """Returns a rotation by a quarter turn."""
    pose = Pose()
    pose.orientation.w = 0.5
    return pose


def above(height):
    pose = Pose()
    pose.position.z = height
    return pose


if __name__ == "__main__":
    rospy.init_node("test_robots")
    rostest.rosrun("constraint_sim", "robots", Robots)
