#!/usr/bin/env python3
"""Malicious or wrong input and dead callers: answered, rejected or cancelled, whatever runs."""
import contextlib
import functools
import io
import math
import os
import random
import re
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import xmlrpc.client

import genmsg.msgs
import roslib.message
import rosgraph
import rosnode
import rospkg
import rospy
import rosservice
import rostest
from constraint_sim.msg import BodyState, MotorBias, Statistics
from constraint_sim.srv import GetBodyState, Step
from geometry_msgs.msg import Twist, WrenchStamped
from rosgraph_msgs.msg import Log
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import support
from support import (NODE, Listener, call, memory_of, node_command, properties, running, sphere,
                     wait_until)

# Time in which calls are answered and the node ends [s]. Other work of the machine adds to it: a single trial
# may take QUICK, of many calls the median counts, of repeated trials the least. The world shows that a
# response did not wait for a tick.
SECOND, QUICK = 1.0, 10.0
CALLS_A_SECOND = 100
MOST_STEPS = 7  # number of simultaneous calls of step
# A tick of half a minute of processor time and more, far beyond QUICK, so that only stopping ends it: the
# largest number of sweeps over 500 spheres in one place, which touch in 125 000 points.
ENDLESS = """
world: {iterations: 10000, method: sequential_impulses}
constraints: [{name: leash, type: rope, body_b: ball, max_length: 20}]
bodies:
- {name: ball, mass: 1, position: [1, 0, 9]}
""" + "".join("- {name: s%d, mass: 1, position: [%g, 0, 0], shape: {sphere: {radius: 1}}}\n"
              % (i, 1e-3 * i) for i in range(500))
ARM = """
bodies:
- {name: carrier, type: kinematic, position: [9, 0, 0]}
- {name: arm, mass: 1, shape: {box: {size: [0.1, 0.1, 0.5]}}}
constraints:
- {name: elbow, type: hinge, body_b: arm, axis_a: [0, 1, 0], motor: {bias: 0}}
"""

# Rotating poles of 10 km beside each other: the search for impacts takes ten seconds of the processor a tick.
POLES = "world: {time_step: 0.01, method: sequential_impulses}\nbodies:\n" + "".join(
    "- {name: p%d, mass: 1000, position: [0, 0, %g], shape: {cylinder: {radius: 1, length: 10000}}, "
    "orientation: [0.70710678118654752, 0, 0, 0.70710678118654752], "
    "angular_velocity: [0.01, 0.01, %g]}\n" % (i, 3 * i, (-1) ** i) for i in range(1600))
RANDOM_CALLS = 3000 if "CONSTRAINT_SIM_TEST_ALL" in os.environ else 30  # for each service
NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-9, 1e9, 1e20, -1e20, 1e300, 5e-324, math.inf, -math.inf, math.nan)
WORDS = ("bob", "rod", "arm", "elbow", "world", "", "nobody", "mass", "tolerance", "hinge", "1e-6", "[",
         "a/b", "\0", "..", "\n", "bodies: []")


def raw(message_class, data):
    """Returns a message or request that is sent as these bytes."""
    class Raw(message_class):
        __slots__ = ()

        def serialize(self, buff):
            buff.write(data)
    return Raw()


def random_value(draw, kind):
    """Returns a value of a field of this type."""
    base, is_list = genmsg.msgs.parse_type(kind)[:2]
    if is_list and kind != "uint8[]":
        return [random_value(draw, base) for _ in range(draw.randrange(3))]
    if kind == "uint8[]":
        return bytes(draw.randrange(256) for _ in range(draw.randrange(9)))
    if base == "string":
        return draw.choice(WORDS)
    if base in ("float32", "float64"):
        return draw.choice(NUMBERS) if draw.random() < 0.3 else draw.uniform(-2, 2)
    if base == "bool":
        return draw.random() < 0.5
    if base in ("time", "duration"):
        return (rospy.Time if base == "time" else rospy.Duration)(draw.randrange(1 << 31),
                                                                  draw.randrange(10 ** 9))
    if re.fullmatch(r"u?int\d+|byte|char", base):
        return draw.randrange(4)
    return random_message(draw, roslib.message.get_message_class(
        "std_msgs/Header" if base == "Header" else base))


def random_message(draw, message_class):
    message = message_class()
    for name, kind in zip(message.__slots__, message._slot_types):
        value = random_value(draw, kind)
        if isinstance(value, float) and kind == "float32":
            value = 0.5
        setattr(message, name, value)
    return message


def random_bytes(draw, message_class):
    """Returns the bytes of a random message, damaged in half of the cases."""
    buff = io.BytesIO()
    random_message(draw, message_class).serialize(buff)
    data = bytearray(buff.getvalue())
    if draw.random() < 0.5:
        for _ in range(draw.randrange(1, 4)):
            if data:
                data[draw.randrange(len(data))] = draw.choice((0, 1, 127, 128, 255, draw.randrange(256)))
        del data[draw.randrange(len(data) + 1) if draw.random() < 0.3 else len(data):]
    return bytes(data)


def chain(joints):
    """Returns a URDF of a chain of hinges."""
    link = ('<link name="l%d"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
            'iyz="0"/></inertial><collision><geometry><sphere radius="1"/></geometry></collision></link>')
    joint = ('<joint name="j%d" type="continuous"><parent link="l%d"/><child link="l%d"/>'
             '<axis xyz="0 1 0"/></joint>')
    return ('<robot name="chain">' + "".join(link % i for i in range(joints + 1)) +
            "".join(joint % (i, i, i + 1) for i in range(joints)) + "</robot>")


@contextlib.contextmanager
def node(**parameters):
    with running(node_command(**parameters)) as process:
        properties()  # the node is up
        yield process
        assert process.poll() is None, "the node has ended"


def peak_memory_of(process):
    """Returns the peak resident memory [MiB]."""
    with open("/proc/%d/status" % process.pid) as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM:")) / 1024


@functools.lru_cache()
def class_of(service):
    return rosservice.get_service_class_by_name(service)


def call_raw(service, data):
    """Makes a call with these bytes as its request."""
    service = rospy.names.ns_join(NODE, service)
    return rospy.ServiceProxy(service, class_of(service))(raw(class_of(service)._request_class, data))


def seconds_of(work):
    start = time.monotonic()
    work()
    return time.monotonic() - start


class DeadCaller:
    """A caller that requests steps and dies before they are done."""

    def __init__(self, steps):
        uri = rospy.get_master().lookupService(NODE + "/step")[2]
        host, port = uri[len("rosrpc://"):].rstrip("/").split(":")
        fields = ["callerid=/dead", "service=%s/step" % NODE, "md5sum=%s" % Step._md5sum]
        header = b"".join(struct.pack("<I", len(f)) + f.encode() for f in fields)
        self.socket = socket.create_connection((host, int(port)), timeout=support.TIMEOUT)
        self.socket.sendall(struct.pack("<I", len(header)) + header)
        self.socket.recv(struct.unpack("<I", self.socket.recv(4))[0])
        self.socket.sendall(struct.pack("<II", 4, steps))

    def die(self):
        self.socket.close()


class DeafListener:
    """A subscriber of edit_log that never reads."""

    def __init__(self):
        topic = NODE + "/edit_log"
        uri = rosnode.get_api_uri(rosgraph.Master("/test"), NODE)
        _, host, port = xmlrpc.client.ServerProxy(uri).requestTopic("/deaf", topic, [["TCPROS"]])[2]
        fields = ["callerid=/deaf", "topic=" + topic, "md5sum=*", "type=*"]
        header = b"".join(struct.pack("<I", len(f)) + f.encode() for f in fields)
        self.socket = socket.create_connection((host, port), timeout=support.TIMEOUT)
        self.socket.sendall(struct.pack("<I", len(header)) + header)

    def read_to_the_end(self):
        while self.socket.recv(1 << 20):
            pass


class Traffic:
    """Random calls, valid and invalid, a hundred a second beside a test."""

    def __init__(self):
        self.random = random.Random(7)
        self.made, self.seconds, self.errors = 0, [], []
        self._lock = threading.Lock()
        self._proxies = {name: rospy.ServiceProxy(
            NODE + "/" + name, rosservice.get_service_class_by_name(NODE + "/" + name))
            for name in ("add_body", "remove_body", "get_body_state", "set_body_state",
                         "get_world_properties", "save_scene", "set_motor_bias",
                         "remove_constraint", "apply_body_wrench")}
        self._start = time.monotonic()
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._run) for _ in range(4)]
        for thread in self._threads:
            thread.start()

    def _arguments(self, name):
        body = "b%d" % self.random.randrange(5)
        return {"add_body": {"body": sphere(body, z=self.random.choice([1.0, 9.0, float("nan")]))},
                "set_body_state": {"state": BodyState(name=body)},
                "get_world_properties": {}, "save_scene": {},
                "set_motor_bias": {"constraint": "leash", "bias": 0.0},
                "apply_body_wrench": {"body_name": body}}.get(name, {"name": body})

    def _run(self):
        while not self._stop.is_set():
            with self._lock:
                self.made += 1
                due = self._start + self.made / CALLS_A_SECOND
                name = self.random.choice(sorted(self._proxies))
                arguments = self._arguments(name)
            time.sleep(max(0.0, due - time.monotonic()))
            start = time.monotonic()
            try:
                self._proxies[name](**arguments)
                self.seconds.append(time.monotonic() - start)
            except rospy.ServiceException as error:
                self.errors.append("%s: %s" % (name, error))

    def stop(self):
        self._stop.set()
        for thread in self._threads:
            thread.join()


@contextlib.contextmanager
def traffic(test):
    """Expects that no call is lost or takes long."""
    beside = Traffic()
    try:
        yield beside
    finally:
        beside.stop()
    test.assertEqual(beside.errors, [])
    test.assertEqual(len(beside.seconds), beside.made)
    test.assertLess(statistics.median(beside.seconds), SECOND)
    test.assertLess(max(beside.seconds), QUICK)


class Hostile(unittest.TestCase):
    def tearDown(self):
        Listener.stop_all()

    def quick(self, name, /, **fields):
        """Returns the response, which must arrive fast."""
        start = time.monotonic()
        answer = call(name, **fields)
        self.assertLess(time.monotonic() - start, QUICK, name)
        return answer

    def refused(self, words, name, /, **fields):
        answer = self.quick(name, **fields)
        self.assertFalse(answer.success, "%s accepted %s" % (name, fields))
        for word in words:
            self.assertIn(word, answer.status_message)

    # ---- what never ends

    def test_a_tick_without_end_keeps_nobody_waiting(self):
        with node(scene="pendulum") as process, traffic(self) as beside:
            before, memory = memory_of(process), []
            for end in 3 * ("pause_physics", "load_scene", "reset_world", "reset_simulation"):
                self.assertTrue(self.quick("load_scene", text=ENDLESS).success)
                first = self.quick("get_world_properties").step
                self.quick("unpause_physics")
                made = beside.made
                wait_until(lambda: beside.made > made + 10, "calls during the tick")
                stood = self.quick("get_world_properties")
                self.assertTrue(stood.success and not stood.paused)
                self.assertTrue(self.quick("get_body_state", name="ball").success)
                self.refused(["not now", "pause_physics"], "remove_constraint", name="leash")
                # none of them has waited for the tick, which is still the first one
                after = self.quick("get_world_properties")
                self.assertEqual((stood.step, after.step), (first, first))
                self.assertEqual(after.state_hash, stood.state_hash)
                self.assertTrue(self.quick("save_scene").success)
                self.quick(end, **({"path": "pendulum"} if end == "load_scene" else {}))
                if end == "pause_physics":
                    # the tick is abandoned; simultaneous calls may edit the world from now on
                    self.assertEqual(properties().step, first)
                    self.assertTrue(self.quick("remove_constraint", name="leash").success)
                memory.append(memory_of(process))
            self.quick("pause_physics")
            # Measured: a tick of 125 000 contacts takes 125 MiB, some of which remain until the next one, and
            # later ticks take 0 to 31 MiB more, whatever their number: one list is in another arena. A list
            # of 30 MiB that leaked in each of the last eight would be 240 MiB.
            self.assertLess(max(memory) - before, 300.0, memory)
            self.assertLess(max(memory[4:]) - max(memory[:4]), 100.0, memory)

    def test_steps_of_dead_callers_keep_nobody_waiting_and_are_cancelled(self):
        with node(scene="pendulum", paused="true") as process, traffic(self):
            before = memory_of(process)
            callers = [DeadCaller(4294967295) for _ in range(12)]  # more than can wait
            wait_until(lambda: properties().step > 0, "steps")
            for caller in callers:
                caller.die()
            self.assertTrue(self.quick("add_body", body=sphere("late", 5, 0, 9)).success)
            self.assertTrue(self.quick("save_scene").success)
            self.quick("pause_physics")
            stood = properties().step
            self.assertTrue(self.quick("step", steps=3).success)
            self.assertEqual(properties().step, stood + 3)
            self.assertLess(memory_of(process) - before, 50.0)

    def test_waiting_steps_are_cancelled_with_what_was_done(self):
        with node(scene="pendulum", paused="true"):
            for end, fields in (("pause_physics", {}), ("load_scene", {"path": "winch"}),
                                ("reset_world", {}), ("reset_simulation", {})):
                call("load_scene", path="pendulum")
                first, answers = properties().step, []
                thread = threading.Thread(
                    target=lambda: answers.append(call("step", steps=4294967295)))
                thread.start()
                wait_until(lambda: properties().step > first, "the first step")
                self.quick(end, **fields)
                thread.join(QUICK)
                self.assertFalse(thread.is_alive(), end)
                self.assertFalse(answers[0].success)
                for word in (end, "of 4294967295 steps"):
                    self.assertIn(word, answers[0].status_message)
                # state after the steps, before the cancelling call
                self.assertEqual([b.name for b in answers[0].bodies], ["bob"])
                same = answers[0].state_hash == properties().state_hash
                self.assertEqual(same, end == "pause_physics")

    def test_a_world_that_could_not_be_loaded_again_is_not_saved(self):
        with node(paused="true"), tempfile.TemporaryDirectory() as folder:
            text = "bodies:\n" + "".join("- {name: b%d, mass: 1}\n" % i for i in range(30000))
            self.assertTrue(call("load_scene", text=text).success)
            # 6 MiB take a second of processor time
            answer = call("save_scene", path=folder + "/large.yaml")
            self.assertFalse(answer.success)
            for word in ("6 MiB", "loaded again"):
                self.assertIn(word, answer.status_message)
            self.assertEqual(os.listdir(folder), [])

    def test_texts_that_no_scene_is_are_refused_at_once(self):
        with node() as process:
            before = memory_of(process)
            for text in (",", "[" * 100000, "world: {threads: 100000}",
                         "world: {iterations: 2147483647}"):
                self.refused(["text"], "load_scene", text=text)
            self.assertLess(memory_of(process) - before, 50.0)

    def test_a_tick_of_long_poles_keeps_nobody_waiting(self):
        with node(scene="pendulum"):
            for end in ("load_scene", "reset_world"):
                self.assertTrue(self.quick("load_scene", text=POLES).success)
                first = self.quick("get_world_properties").step
                self.quick("unpause_physics")
                wait_until(lambda: "not now" in self.quick("remove_body", name="p0").status_message,
                           "the long tick")
                self.assertTrue(self.quick("get_body_state", name="p1").success)
                self.assertEqual(self.quick("get_world_properties").step, first)
                self.quick(end, **({"path": "pendulum"} if end == "load_scene" else {}))

    # ---- bytes

    def test_lengths_of_lists_that_are_not_there_take_no_memory(self):
        # roscpp allocates the list with its announced length, here 0.8 GB and more, before it reads on
        many = struct.pack("<I", 2000000)
        with node() as process:
            before = peak_memory_of(process)
            for service, data in (("apply_edits", many), ("apply_edits", struct.pack("<I", 0) + many),
                                  ("set_options", many),
                                  # 2^29 + 1 numbers, whose size in bytes is 8 in 32-bit arithmetic
                                  ("set_body_properties",
                                   struct.pack("<IIId", 0, 0, 0x20000001, 0.0))):
                with self.assertRaises(rospy.ServiceException):
                    call_raw(service, data)
            publisher = rospy.Publisher(NODE + "/joint_trajectory", JointTrajectory, queue_size=10)
            wait_until(lambda: publisher.get_num_connections() > 0, "the node to listen")
            for _ in range(3):
                publisher.publish(raw(JointTrajectory, struct.pack("<IIII", 0, 0, 0, 0) + many))
            # a further, accepted one shows that those before it were read
            log = Listener("/rosout", Log)

            def is_told():
                publisher.publish(JointTrajectory(joint_names=["nobody"]))
                return any("joint_trajectory" in m.msg for m in log.messages)
            wait_until(is_told, "a warning of joint_trajectory")
            self.assertLess(peak_memory_of(process) - before, 50.0)

    def test_a_listener_of_edit_log_that_never_reads_takes_a_bounded_memory(self):
        with node() as process:
            listener = DeafListener()
            before = peak_memory_of(process)
            for _ in range(120):  # the record of an edit is its request, blanks before a number included
                value = 5 * 2**20 * " " + "60"
                self.assertTrue(call("set_options", keys=["publish_rate"], values=[value]).success)
            # 600 MiB of records; up to 256 MiB may wait, and a call takes a few copies of its request
            self.assertLess(peak_memory_of(process) - before, 400.0)
            listener.read_to_the_end()  # it was disconnected

    def test_random_bytes_are_answered(self):
        draw = random.Random(1)
        with tempfile.TemporaryDirectory() as folder, node(scene="pendulum", scene_folder=folder) as process:
            services = sorted(name for name in rosservice.get_service_list(node=NODE)
                              if "logger" not in name)
            self.assertGreater(len(services), 25)
            memory = []
            for k in range(RANDOM_CALLS):
                for name in services:
                    data = random_bytes(draw, class_of(name)._request_class)
                    if name.endswith(("/step", "/verify")) and data[1:4] != bytes(3):
                        continue  # is slow by its nature
                    start = time.monotonic()
                    with contextlib.suppress(rospy.ServiceException):
                        call_raw(name, data)
                    self.assertLess(time.monotonic() - start, QUICK, name)
                if k % (RANDOM_CALLS // 10) == 0:
                    self.quick("load_scene", text="bodies: []")
                    memory.append(memory_of(process))
            self.assertLess(max(memory[5:]) - max(memory[:5]), 50.0, memory)

    # ---- large edits

    @contextlib.contextmanager
    def served_beside(self):
        """Expects that queries are answered all the time."""
        proxy = rospy.ServiceProxy(NODE + "/get_body_state", GetBodyState, persistent=True)
        seconds, done = [], threading.Event()

        def ask():
            while not done.is_set():
                seconds.append(seconds_of(lambda: self.assertTrue(proxy("witness", "").success)))
        thread = threading.Thread(target=ask)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
        self.assertGreater(len(seconds), 0)
        self.assertLess(statistics.median(seconds), SECOND)
        self.assertLess(max(seconds), QUICK)

    def test_large_edits_take_time_by_their_size_alone(self):
        count = 30000
        names = ["b%d" % i for i in range(count)]
        far = [sphere(name, 1e3 * i) for i, name in enumerate(names)]
        # nonlinear costs take minutes: measured 44 s for 50 000 removals and 70 s for the robot
        with node(paused="true"):
            self.assertTrue(self.quick("add_body", body=sphere("witness", y=50)).success)
            with self.served_beside():
                for fields in ({"bodies": far}, {"states": [BodyState(name=n) for n in names]},
                               {"remove_bodies": names}):
                    answer = self.quick("apply_edits", **fields)
                    self.assertTrue(answer.success, answer.status_message)
                self.refused(["100000", "100001"], "apply_edits", remove_bodies=["x"] * 100001)
                keys = ["k%d" % i for i in range(60000)]
                self.refused(["keys"], "set_options", keys=keys, values=["1"] * len(keys))
                self.refused(["keys"], "set_body_properties", name="witness", keys=keys,
                             values=[1.0] * len(keys))
                self.refused(["must be"], "set_options", keys=["tolerance"], values=["[" * 1000000])
                answer = self.quick("load_urdf", text=chain(3300))
                self.assertTrue(answer.success, answer.status_message)
                joints = [name for name in answer.constraints if "no_contact/" not in name]
                self.assertEqual(len(joints), 3300)
                self.assertLess(len(answer.status_message), 10000)  # all links overlap
                self.assertTrue(self.quick("apply_edits", remove_bodies=answer.bodies).success)

    # ---- messages

    def test_no_message_ends_the_node_or_the_physics(self):
        log = Listener("/rosout", Log)
        topics = {}

        def send(topic, message, *words):
            """Publishes until the log shows it, since a topic has no response."""
            if topic not in topics:
                topics[topic] = rospy.Publisher(NODE + "/" + topic, type(message), queue_size=10)
            heard = len(log.messages)

            def told():
                topics[topic].publish(message)
                return any(all(word in m.msg for word in (topic,) + words)
                           for m in log.messages[heard:])
            wait_until(told, "a warning of %s" % topic)

        def trajectory(position=0.0, stamp=rospy.Time()):
            message = JointTrajectory(joint_names=["elbow"])
            message.header.stamp = stamp
            message.points.append(JointTrajectoryPoint(
                positions=[position], time_from_start=rospy.Duration(1.0)))
            return message

        with node(command="elbow", cmd_vel="carrier", wrench="arm", publish_tf="false"):
            self.assertTrue(self.quick("load_scene", text=ARM).success)
            last = rospy.Time(4294967295, 999999999)
            send("joint_trajectory", trajectory(stamp=last), "header.stamp", "4294967295")
            for value in (1e308, math.nan, math.inf):
                send("joint_trajectory", trajectory(value), "points[0]")
                send("motor_bias", MotorBias(constraint="elbow", bias=value), "bias")
            send("command/elbow", Float64(math.nan), "data")
            for value in (1e308, math.nan):
                twist, wrench = Twist(), WrenchStamped()
                twist.linear.x = wrench.wrench.torque.y = value
                send("cmd_vel/carrier", twist)
                send("wrench/arm", wrench)
            before = properties()
            self.assertFalse(before.paused)
            wait_until(lambda: properties().step > before.step + 10, "steps")
            # drives that fail a step, here by leaving the range, end with the edit that follows
            twist = Twist()
            twist.linear.x = 1e20
            topics["cmd_vel/carrier"].publish(twist)
            wait_until(lambda: any("cmd_vel: ended by a step that failed: carrier" in m.msg
                                   for m in log.messages), "the end of the drive")
            self.assertTrue(self.quick("set_body_state", state=BodyState(name="carrier")).success)
            before = properties()
            self.assertFalse(before.paused)
            wait_until(lambda: properties().step > before.step + 10, "steps after it")

    def test_nothing_enters_the_node_but_through_a_guard(self):
        folder = os.path.join(rospkg.RosPack().get_path("constraint_sim"), "src", "ros")
        for name in os.listdir(folder):
            if name == "guarded.h":
                continue
            with open(os.path.join(folder, name)) as file:
                text = file.read()
            found = re.findall(r"(?<!guarded_)\b(?:subscribe|advertiseService)\s*[<(]"
                               r"|create\w*Timer|TransformListener", text)
            self.assertEqual(found, [], name)

    # ---- files

    def test_only_regular_files_up_to_a_size_are_read_and_written(self):
        with tempfile.TemporaryDirectory() as folder, node():
            os.mkfifo(folder + "/fifo")
            with open(folder + "/large", "w") as file:
                file.truncate((6 << 20) + 1)
            for path in (folder + "/fifo", "/dev/zero", "/dev/stdin", "/dev/full"):
                self.refused(["regular", path], "load_scene", path=path)
                self.refused(["regular", path], "save_scene", path=path)
            self.refused(["directory"], "load_scene", path=folder)
            self.refused(["MiB"], "load_scene", path=folder + "/large")
            self.assertEqual(sorted(os.listdir(folder)), ["fifo", "large"])

    def test_a_message_quotes_little_of_a_file(self):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file, node():
            file.write("root:" + "x" * 5000 + "'" + "y" * 5000)
            file.flush()
            message = self.quick("load_scene", path=file.name).status_message
            self.assertNotIn("x" * 41, message)
            self.assertNotIn("y", message.split(file.name)[1])

    def test_paths_stay_below_the_scene_folder(self):
        with tempfile.TemporaryDirectory() as folder:
            os.mkdir(folder + "/scenes")
            for name in ("secret.yaml", "scenes/a.yaml"):
                with open(folder + "/" + name, "w") as file:
                    file.write("bodies: []")
            os.symlink("../secret.yaml", folder + "/scenes/out.yaml")
            os.symlink("a.yaml", folder + "/scenes/within.yaml")
            with node(scene_folder=folder + "/scenes"):
                for path in ("../secret.yaml", folder + "/secret.yaml", "/etc/passwd", "out.yaml"):
                    self.refused(["scene_folder"], "load_scene", path=path)
                    self.refused(["scene_folder"], "save_scene", path=path)
                self.refused(["package"], "load_scene",
                             path="package://constraint_sim/../../secret.yaml")
                for path in ("a.yaml", folder + "/scenes/a.yaml", "within.yaml", "pendulum",
                             "package://constraint_sim/config/scenes/bridge.yaml"):
                    self.assertTrue(self.quick("load_scene", path=path).success, path)
                self.assertTrue(self.quick("save_scene", path="new.yaml").success)
            self.assertEqual(sorted(os.listdir(folder + "/scenes")),
                             ["a.yaml", "new.yaml", "out.yaml", "within.yaml"])
            with open(folder + "/secret.yaml") as file:
                self.assertEqual(file.read(), "bodies: []")

    # ---- numbers

    def test_times_beyond_those_of_ros_neither_end_it_nor_are_infinite(self):
        statistics = Listener(NODE + "/statistics", Statistics)
        with node(paused="true", publish_clock="true"):
            for tick in ("1.0e+10", "1.0e+308"):
                loaded = self.quick("load_scene", text="world: {time_step: %s}\nbodies: "
                                    "[{name: b, type: kinematic}]" % tick)
                if not loaded.success:  # such a long tick is rejected
                    self.assertIn("time_step", loaded.status_message)
                    continue
                self.quick("step", steps=3)
                now = self.quick("get_world_properties")
                self.assertLess(now.sim_time, float("inf"))
                statistics.wait(lambda m: m.step == now.step, "statistics")
                self.quick("reset_simulation")
            self.assertTrue(self.quick("load_scene", path="pendulum").success)
            self.assertTrue(self.quick("step", steps=3).success)

    # ---- the end

    def ended(self, process, number):
        """Returns the seconds until the process has ended."""
        seconds = seconds_of(lambda: (process.send_signal(number),
                                      process.wait(timeout=support.TIMEOUT)))
        self.assertLess(seconds, QUICK)
        return seconds

    def ended_well(self, process, number):
        """Returns the seconds; infinite where the end was forced, as on a busy machine without time to
        answer waiting callers."""
        seconds = self.ended(process, number)
        if process.returncode == 128 + number:
            return math.inf
        self.assertEqual(process.returncode, 0)
        self.assertNotIn(NODE, rosnode.get_node_names())
        return seconds

    def within_a_second(self, end, *arguments):
        """Repeats a trial: a time limit fails only if each trial exceeds it. Forced ends alone are enough
        where more than four processes wait for each processor."""
        seconds = []
        while not seconds or (seconds[-1] >= SECOND and len(seconds) < 20):
            seconds.append(end(*arguments))
            if seconds[-1] == math.inf and os.getloadavg()[0] > 4 * os.cpu_count():
                return
        self.assertLess(seconds[-1], SECOND, seconds)

    def end_beside_those_who_wait(self, number):
        with running(node_command(scene="pendulum", paused="true")) as process:
            properties()
            answers = []
            waiting = [threading.Thread(target=lambda: answers.append(
                call("step", steps=4294967295))) for _ in range(MOST_STEPS + 1)]
            for thread in waiting:
                thread.start()
            # one of them is rejected when all others wait
            wait_until(lambda: answers, "the refusal")
            self.assertIn("calls wait already", answers[0].status_message)
            seconds = self.ended_well(process, number)
            for thread in waiting:
                thread.join(QUICK)
            if seconds == math.inf:
                return seconds
            self.assertEqual([a.success for a in answers], [False] * (MOST_STEPS + 1))
            for answer in answers[1:]:
                self.assertIn("shutting down", answer.status_message)
                self.assertEqual(len(answer.bodies), 1)
            return seconds

    def end_in_a_tick_without_end(self, number):
        with running(node_command(scene="pendulum", paused="true")) as process:
            properties()
            call("load_scene", text=ENDLESS)
            call("unpause_physics")
            wait_until(lambda: not call("remove_body", name="ball").success, "the long tick")
            return self.ended_well(process, number)

    def end_while_it_starts(self, number, delay):
        with running(node_command(scene="bridge")) as process:
            with self.assertRaises(subprocess.TimeoutExpired):
                process.wait(timeout=delay)
            return self.ended(process, number)

    def test_it_ends_within_a_second_at_any_moment_and_answers_those_who_wait(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            self.within_a_second(self.end_beside_those_who_wait, number)
            self.within_a_second(self.end_in_a_tick_without_end, number)

    def test_it_ends_within_a_second_while_it_starts(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            for delay in (0.0, 0.05):
                self.within_a_second(self.end_while_it_starts, number, delay)

    def test_it_ends_within_a_second_on_a_busy_machine(self):
        busy = [sys.executable, "-c", "while True: pass"]
        with contextlib.ExitStack() as loops:
            for _ in range(2 * os.cpu_count()):
                loop = subprocess.Popen(busy)
                loops.callback(loop.wait)
                loops.callback(loop.kill)
            self.within_a_second(self.end_in_motion, signal.SIGINT)

    def end_in_motion(self, number):
        with running(node_command(scene="bridge")) as process:
            first = properties().step
            wait_until(lambda: properties().step > first, "steps")
            return self.ended_well(process, number)

    def test_a_second_node_of_one_name_ends_the_first_and_stays(self):
        with running(node_command(scene="pendulum")) as first:
            properties()
            with running(node_command(scene="winch")) as second:
                wait_until(lambda: first.poll() is not None, "the end of the first")
                self.assertEqual(first.returncode, 0)
                wait_until(lambda: properties().bodies == ["floor", "load"], "the second")
                self.ended_well(second, signal.SIGINT)


if __name__ == "__main__":
    rospy.init_node("test_hostile")
    rostest.rosrun("constraint_sim", "hostile", Hostile)
