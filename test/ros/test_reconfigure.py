#!/usr/bin/env python3
"""Options as parameters of dynamic_reconfigure: the list and the checks of set_options."""
import math

import dynamic_reconfigure
import rospy
import rostest
import yaml
from constraint_sim.msg import EditRecord
from dynamic_reconfigure.client import Client
from dynamic_reconfigure.msg import DoubleParameter
from dynamic_reconfigure.srv import Reconfigure
from rosgraph_msgs.msg import Log

import support
from support import NODE, Listener, call, properties, sphere, wait_until


def number_of(value):
    """Returns a number: PyYAML reads 1e-08, without a point, as text."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def options():
    """Returns the world's options, as saved."""
    saved = yaml.safe_load(call("save_scene").text)["world"]
    return {name: number_of(value) for name, value in saved.items()}


class Parameters(support.ServiceCase):
    @classmethod
    def setUpClass(cls):
        cls.client = Client(NODE, timeout=support.TIMEOUT)

    def setUp(self):
        self.good("load_scene", path="pendulum")
        self.good("set_options", keys=["real_time_factor", "publish_rate"], values=["0.5", "20"])

    def read(self, **expected):
        """Waits until the client has these values."""
        def is_so():
            heard = self.client.get_configuration(timeout=support.TIMEOUT)
            return all(heard[name] == value for name, value in expected.items())
        wait_until(is_so, "the parameters %s" % expected)

    def refused(self, words, **changes):
        """Expects a failure that changes nothing, and a log line with field and value."""
        log = Listener("/rosout", Log)
        wait_until(lambda: "/rosout" in support.topics_between(NODE, rospy.get_name()), "the log")
        before, saved = properties().state_hash, options()
        with self.assertRaises(dynamic_reconfigure.DynamicReconfigureCallbackException):
            self.client.update_configuration(changes)
        wait_until(lambda: any(all(word in m.msg for word in ["set_parameters"] + words)
                               for m in log.messages), "a message with %s" % words)
        self.assertEqual(properties().state_hash, before)
        self.assertEqual(options(), saved)

    def tearDown(self):
        Listener.stop_all()

    def test_what_the_launch_file_says_holds_at_the_start(self):
        # defaults of dynamic_reconfigure would be 1 and 50
        descriptions = self.client.get_parameter_descriptions(timeout=support.TIMEOUT)
        default = {each["name"]: each["default"] for each in descriptions}
        self.assertEqual((default["real_time_factor"], default["publish_rate"]), (0.5, 20.0))
        saved = options()
        for name, value in saved.items():
            if name == "clock":
                continue
            if name == "gravity":
                self.assertEqual([default["gravity_" + axis] for axis in "xyz"], value)
            else:
                self.assertEqual(default[name], value, name)
        self.assertEqual(len(default), len(saved) - ("clock" in saved) + 2 + 2)

    def test_every_parameter_is_set_and_read_back(self):
        changes = {"gravity_z": -1.62, "tolerance": 1e-10, "order": 5, "stiff_order": 2,
                   "dissipation": True, "method": "energy_momentum", "iterations": 20,
                   "sleep_after": math.inf, "baumgarte": 0.2, "time_step": 0.005,
                   "stiffness_limit": 1.5, "warm_starting": False, "closing_time": 1.0,
                   "sleep_speed": 1e-6, "threads": 2, "contact_tolerance": 1e-4,
                   "event_work": 5000.0}
        said = self.client.update_configuration(dict(changes, real_time_factor=0.25,
                                                     publish_rate=40.0))
        saved = options()
        self.assertEqual(saved.pop("gravity"), [0, 0, -1.62])
        for name, value in changes.items():
            self.assertEqual(said[name], value, name)
            if name != "gravity_z":
                self.assertEqual(saved[name], value, name)
        self.assertEqual((said["real_time_factor"], said["publish_rate"]), (0.25, 40.0))
        self.read(real_time_factor=0.25, publish_rate=40.0, **changes)

    def test_a_ball_falls_by_the_gravity_that_was_set(self):
        self.good("load_scene", text="bodies: []")
        self.good("add_body", body=sphere("ball", z=100.0))
        self.client.update_configuration({"gravity_x": 1.0, "gravity_z": -2.0})
        self.good("step", steps=100)
        v = call("get_body_state", name="ball").state.twist.linear
        self.assertAlmostEqual(v.x, 1.0, delta=1e-12)
        self.assertAlmostEqual(v.z, -2.0, delta=1e-12)

    def test_what_others_change_is_told(self):
        self.good("set_options", keys=["tolerance", "publish_rate"], values=["1e-6", "10"])
        self.read(tolerance=1e-6, publish_rate=10.0)
        self.good("load_scene", text="world: {order: 5, gravity: [0, 1, 0]}")
        self.read(order=5, gravity_y=1.0, gravity_z=0.0)

    def test_what_cannot_be_is_refused_and_told(self):
        self.refused(["tolerance", "-1"], tolerance=-1.0)
        self.refused(["gravity"], gravity_x=math.nan)
        self.refused(["order", "7"], order=7, iterations=30)
        self.refused(["method"], method="newton")
        self.refused(["real_time_factor"], real_time_factor=-1.0, order=5)
        self.refused(["publish_rate"], publish_rate=0.0)
        with self.assertRaises(rospy.ServiceException):
            request = Reconfigure._request_class()
            request.config.doubles = [DoubleParameter("gravty", 1.0)]
            rospy.ServiceProxy(NODE + "/set_parameters", Reconfigure)(request)

    def test_a_recorded_change_is_replayed(self):
        log = Listener(NODE + "/edit_log", EditRecord)
        wait_until(lambda: log.messages, "the world that the log begins with")
        self.client.update_configuration({"tolerance": 1e-6})
        wait_until(lambda: any(m.service == "set_options" for m in log.messages), "its record")


if __name__ == "__main__":
    rospy.init_node("test_reconfigure")
    rostest.rosrun("constraint_sim", "reconfigure", Parameters)
