#!/usr/bin/env python3
"""The simulator as a nodelet: loaded, unloaded while busy, and two at once."""
import threading
import time
import unittest

import rospy
import rostest
from nodelet.srv import NodeletList, NodeletLoad, NodeletUnload
from tf2_msgs.msg import TFMessage

import support
from support import Listener, call, sphere

MANAGER = "/manager"
# Time in which a simulator must be gone, whatever it does [s]: a second, and ten times that on a busy
# machine.
QUICK = 10.0


def manager(service, service_type, *arguments):
    name = MANAGER + "/" + service
    rospy.wait_for_service(name, timeout=support.TIMEOUT)
    return rospy.ServiceProxy(name, service_type)(*arguments)


def load(name, **parameters):
    for parameter, value in parameters.items():
        rospy.set_param(name + "/" + parameter, value)
    try:
        return manager("load_nodelet", NodeletLoad, name, "constraint_sim/SimulatorNodelet",
                       [], [], [], "").success
    except rospy.ServiceException:  # the manager rejects it
        return False


def unload(name):
    """Unloads a nodelet; returns the wall time [s]."""
    start = time.monotonic()
    assert manager("unload_nodelet", NodeletUnload, name).success
    return time.monotonic() - start


class Nodelet(unittest.TestCase):
    def tearDown(self):
        for name in manager("list", NodeletList).nodelets:
            unload(name)
        for name in ("/sim", "/left", "/right"):
            if rospy.has_param(name):
                rospy.delete_param(name)

    def test_twenty_loads_and_unloads(self):
        for _ in range(20):
            self.assertTrue(load("/sim", scene="pendulum"))
            self.assertEqual(call("/sim/get_world_properties").bodies, ["bob"])
            self.assertLess(unload("/sim"), QUICK)
        self.assertEqual(manager("list", NodeletList).nodelets, [])

    def test_it_unloads_while_four_clients_call_and_steps_without_end_run(self):
        self.assertTrue(load("/sim", scene="falling_balls", paused=True))
        answers, stop = [], threading.Event()

        def ask_for_steps():
            try:
                answers.append(call("/sim/step", steps=4294967295))
            except (rospy.ServiceException, rospy.ROSException):
                answers.append(None)  # the connection ended with the service

        def edit(client):
            i = 0
            while not stop.is_set():
                try:
                    call("/sim/add_body", body=sphere("b%d_%d" % (client, i), z=100.0))
                except (rospy.ServiceException, rospy.ROSException):
                    return
                i += 1

        threads = [threading.Thread(target=ask_for_steps)]
        threads += [threading.Thread(target=edit, args=[client]) for client in range(4)]
        for thread in threads:
            thread.start()
        support.wait_until(lambda: call("/sim/get_world_properties").step > 10, "steps")
        seconds = unload("/sim")
        stop.set()
        self.assertLess(seconds, QUICK)
        for thread in threads:
            thread.join(timeout=2 * support.TIMEOUT)
            self.assertFalse(thread.is_alive())
        self.assertFalse(answers[0] is not None and answers[0].success)

    def test_two_simulators_in_one_manager(self):
        listener = Listener("/tf", TFMessage)
        self.assertTrue(load("/left", scene="pendulum", frame_prefix="left/"))
        self.assertTrue(load("/right", scene="double_pendulum", frame_prefix="right/"))

        def frames():
            return {t.child_frame_id for m in listener.messages for t in m.transforms}
        expected = {side + "/" + body for side in ("left", "right")
                    for body in call("/" + side + "/get_world_properties").bodies}
        support.wait_until(lambda: frames() == expected, "the frames of both")
        call("/left/pause_physics")
        self.assertTrue(call("/left/get_world_properties").paused)
        self.assertFalse(call("/right/get_world_properties").paused)

    def test_a_scene_that_cannot_be_is_refused_and_the_manager_goes_on(self):
        self.assertFalse(load("/sim", scene="no_such_scene"))
        rospy.delete_param("/sim")
        self.assertTrue(load("/sim", scene="pendulum"))


if __name__ == "__main__":
    rospy.init_node("test_nodelet")
    rostest.rosrun("constraint_sim", "nodelet", Nodelet)
