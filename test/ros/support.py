"""Helpers shared by the node's tests: waiting for conditions, running programs, calls with fields by name."""
import contextlib
import faulthandler
import functools
import os
import signal
import subprocess
import time
import unittest
import xmlrpc.client

import rosgraph
import rosnode
import rospy
import rosservice
from constraint_sim.msg import Body, Shape
from constraint_sim.srv import GetWorldPropertiesRequest  # noqa: F401  (the package must be built)

NODE = "/constraint_sim"
TIMEOUT = 120.0  # far beyond the time of any step here, so that a slow machine causes no failure [s]
faulthandler.dump_traceback_later(500, repeat=True)  # shows where a test hangs, before CTest ends it


def wait_until(condition, what, timeout=TIMEOUT):
    """Returns the first true value of condition(); fails after the timeout."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError("waited %g s in vain for %s" % (timeout, what))


@contextlib.contextmanager
def running(command, **options):
    """Runs a command until the block ends, then interrupts it and waits."""
    process = subprocess.Popen(command, start_new_session=True, **options)
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            process.wait(timeout=TIMEOUT)


@functools.lru_cache()
def node_program():
    """Returns the node's program itself, which starts faster than rosrun and receives signals directly."""
    return subprocess.check_output(["catkin_find", "--first-only", "--libexec", "constraint_sim",
                                    "constraint_sim_node"], universal_newlines=True).strip()


def node_command(**parameters):
    """Returns the command of the node with only these parameters: private ones persist on the parameter
    server."""
    if rospy.has_param(NODE):
        rospy.delete_param(NODE)
    return ([node_program(), "__name:=constraint_sim"] +
            ["_%s:=%s" % item for item in parameters.items()])


def call(name, /, **fields):
    """Calls a service of the node, or of another one by its full name."""
    service = rospy.names.ns_join(NODE, name)
    rospy.wait_for_service(service, timeout=TIMEOUT)
    return rospy.ServiceProxy(service, rosservice.get_service_class_by_name(service))(**fields)


def sphere(name, x=0.0, y=0.0, z=0.0, **fields):
    """Returns a dynamic ball of 1 kg and 0.1 m at a place."""
    body = Body(name=name, mass=1.0, shapes=[Shape(type=Shape.SPHERE, dimensions=[0.1])])
    body.pose.position.x, body.pose.position.y, body.pose.position.z = x, y, z
    for field, value in fields.items():
        setattr(body, field, value)
    return body


def properties():
    return call("get_world_properties")


def empty_world():
    """Loads a paused world without bodies."""
    call("pause_physics")
    assert call("load_scene", text="bodies: []").success
    return properties()


def memory_of(process):
    """Returns the resident memory [MiB]."""
    with open("/proc/%d/status" % process.pid) as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS:")) / 1024


class TransportWithTimeout(xmlrpc.client.Transport):
    def make_connection(self, host):
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection


def topics_between(publisher, subscriber):
    """Returns the topics that a node sends to another one: a subscription is not yet a connection."""
    uri = rosnode.get_api_uri(rosgraph.Master(rospy.get_name()), publisher, skip_cache=True)
    if not uri:
        return set()  # not up yet
    try:
        _, _, connections = xmlrpc.client.ServerProxy(uri, TransportWithTimeout()).getBusInfo(rospy.get_name())
    except ConnectionError:
        return set()  # the node is gone, and the master does not know
    return {topic for _, other, direction, _, topic, *_ in connections
            if direction == "o" and other == subscriber}


def stamp_of(message):
    """Returns the stamp of the message, or of the first of its transforms or markers; 0 without one."""
    if hasattr(message, "header"):
        return message.header.stamp
    parts = message.transforms if hasattr(message, "transforms") else message.markers
    return parts[0].header.stamp if parts else rospy.Time(0)


class Listener:
    """Keeps all messages of a topic."""
    _subscribers = []

    def __init__(self, topic, message_type):
        self.messages = []
        self._subscriber = rospy.Subscriber(topic, message_type, self.messages.append)
        self._subscribers.append(self._subscriber)

    def is_connected(self):
        return self._subscriber.get_num_connections() > 0

    @classmethod
    def stop_all(cls):
        while cls._subscribers:
            cls._subscribers.pop().unregister()

    def find(self, condition=lambda message: True, what="a message", start=0):
        """Returns the first message that meets the condition, also of received ones: latched topics send
        only once."""
        return wait_until(
            lambda: next((m for m in self.messages[start:] if condition(m)), None), what)

    def wait(self, condition=lambda message: True, what="a message"):
        """Returns the first message after this call that meets the condition; the node may have made it
        before."""
        return self.find(condition, what, len(self.messages))

    def present(self, condition=lambda message: True, what="a message"):
        """Returns the first message that meets the condition and is of the world at this call or later,
        where stamps are wall time: not of an intermediate tick."""
        now = rospy.Time.from_sec(time.time())
        return self.find(lambda m: stamp_of(m) >= now and condition(m), what)


class ServiceCase(unittest.TestCase):
    """Calls that must succeed, and calls that must fail and change nothing."""
    told = None  # status_message of a successful call; None: any

    def good(self, name, /, *, told=None, **fields):
        answer = call(name, **fields)
        self.assertTrue(answer.success, answer.status_message)
        told = self.told if told is None else told
        if told is not None:
            self.assertEqual(answer.status_message, told)
        return answer

    def bad(self, named, name, /, **fields):
        """Expects a failure whose message contains `named`, and an unchanged world."""
        before = properties()
        answer = call(name, **fields)
        self.assertFalse(answer.success, "%s accepted %s" % (name, fields))
        for word in named:
            self.assertIn(word, answer.status_message)
        after = properties()
        self.assertEqual(after.state_hash, before.state_hash)
        self.assertEqual((after.bodies, after.constraints), (before.bodies, before.constraints))
