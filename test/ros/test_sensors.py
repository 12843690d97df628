#!/usr/bin/env python3
"""The shipped sensors, constraint_sim/Imu and constraint_sim/Contact, against closed forms."""
import math
import subprocess

import numpy
import rospy
import rostest
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import Imu

import support
from support import NODE, TIMEOUT, node_command, properties, running, wait_until

H = 0.01
G = 9.81
RATE = 2.0  # of the table [rad/s]
SCENE = """
world: {time_step: 0.01}
bodies:
  - {name: floor, type: static, shape: {plane: {}}, friction: 1}
  - {name: table, type: kinematic, position: [5, 0, 1], angular_velocity: [0, 0, 2]}
  - {name: ball, mass: 1, position: [0, 5, 1000]}
  - {name: box, mass: 2, shape: {box: {size: [1, 1, 1]}}, position: [0, 0, 0.5], friction: 1}
  - {name: lid, mass: 1, shape: {box: {size: [1, 1, 1]}}, position: [0, 0, 1.5], friction: 1}
"""


def vector(message):
    return numpy.array([message.x, message.y, message.z])


class Sensors(support.ServiceCase):
    def node(self, plugin, **parameters):
        return running(node_command(plugins="constraint_sim/" + plugin, scene="none", paused="true", **parameters))

    def read(self, steps, count, **topics):
        """Steps the world; returns the messages of each topic, `count` of each."""
        self.good("load_scene", text=SCENE)
        messages = {name: [] for name in topics}
        subscribers = [rospy.Subscriber(NODE + "/" + name.replace("__", "/"), kind, messages[name].append,
                                        queue_size=1000) for name, kind in topics.items()]
        try:
            for subscriber in subscribers:
                wait_until(lambda: subscriber.get_num_connections() > 0, subscriber.name)
            self.good("step", steps=steps)
            wait_until(lambda: all(len(m) >= count for m in messages.values()), "readings")
            self.assertEqual({len(m) for m in messages.values()}, {count})
        finally:
            for subscriber in subscribers:
                subscriber.unregister()
        return messages

    def test_an_imu_reads_what_theory_says(self):
        """The mean specific force of a point at radius r over a step of the angle a = ωh: the velocity ωr turns by
        a, so that in axes at the end the mean acceleration is ωr (−sin a, 1 − cos a)/h."""
        with self.node("Imu", **{"imu/sensors": "turning falling resting", "imu/turning/body": "table",
                                 "imu/turning/position": "[0.5, 0, 0]", "imu/falling/body": "ball",
                                 "imu/resting/body": "lid", "imu/resting/orientation": "[1, 0, 0, 0]"}):
            properties()
            read = self.read(100, 99, imu__turning=Imu, imu__falling=Imu, imu__resting=Imu)
        a = RATE * H
        expected = [-RATE * 0.5 * math.sin(a) / H, RATE * 0.5 * (1 - math.cos(a)) / H, G]
        for message in read["imu__turning"]:
            self.assertLess(numpy.abs(vector(message.linear_acceleration) - expected).max(), 1e-9)
            self.assertLess(numpy.abs(vector(message.angular_velocity) - [0, 0, RATE]).max(), 1e-12)
            self.assertEqual(message.header.frame_id, "turning")
        angle = 2 * math.atan2(message.orientation.z, message.orientation.w)
        self.assertAlmostEqual(math.remainder(angle - RATE * 100 * H, 2 * math.pi), 0.0, delta=1e-9)
        for message in read["imu__falling"]:
            self.assertLess(numpy.abs(vector(message.linear_acceleration)).max(), 1e-9)
        for message in read["imu__resting"][-10:]:  # upside down
            self.assertLess(numpy.abs(vector(message.linear_acceleration) - [0, 0, -G]).max(), 1e-3)
        gaps = {round((b.header.stamp - a.header.stamp).to_sec(), 9) for a, b in
                zip(read["imu__turning"], read["imu__turning"][1:])}
        self.assertGreater(min(gaps), 0.0)

    def test_noise_and_bias_are_of_the_seed(self):
        """A density of 0.1 at 50 Hz is a deviation of 0.1·√50 in a sample. The deviation of a sample of 300 is off by
        1/√600 of itself in one of three cases: 15 % is 3.7 times as much."""
        names = ("one", "same", "other")
        given = {"imu/sensors": " ".join(names)}
        for name in names:
            given.update({"imu/%s/%s" % (name, key): value for key, value in dict(
                body="ball", rate=50, gyroscope_noise=0.1, accelerometer_bias=0.3,
                seed=7 if name == "other" else 3).items()})
        runs = []
        for _ in range(2):
            with self.node("Imu", **given):
                properties()
                read = self.read(601, 300, **{"imu__" + name: Imu for name in names})
                runs.append({name: numpy.array([[*vector(m.angular_velocity), *vector(m.linear_acceleration)]
                                                for m in read["imu__" + name]]) for name in names})
        first = runs[0]["one"]
        self.assertTrue((first == runs[0]["same"]).all())
        self.assertTrue((first == runs[1]["one"]).all())
        self.assertFalse((first == runs[0]["other"]).any())
        deviation = 0.1 * math.sqrt(50)
        self.assertLess(numpy.abs(first[:, :3].std(axis=0) / deviation - 1).max(), 0.15)
        self.assertLess(numpy.abs(first[:, :3].mean(axis=0)).max(), 4 * deviation / math.sqrt(300))
        self.assertAlmostEqual(read["imu__one"][0].angular_velocity_covariance[4], deviation ** 2, delta=1e-9)
        bias = first[:, 3:].mean(axis=0)  # alone: no noise of the accelerometer
        self.assertLess(numpy.abs(first[:, 3:] - bias).max(), 1e-9)
        self.assertTrue((numpy.abs(bias) > 1e-6).all() and (numpy.abs(bias) < 4 * 0.3).all(), bias)

    def test_contact_sensors_read_the_weight(self):
        with self.node("Contact", **{"contact/sensors": "box lid below", "contact/box/body": "box",
                                     "contact/lid/body": "lid", "contact/below/body": "box",
                                     "contact/below/partner": "floor", "contact/below/position": "[0.5, 0, 0]"}):
            properties()
            read = self.read(100, 100, contact__box=WrenchStamped, contact__lid=WrenchStamped,
                             contact__below=WrenchStamped)
        # 1e-3 N: contacts of boxes are solved by sweeps
        for name, weight in (("box", 2 * G), ("lid", G), ("below", 3 * G)):
            wrench = read["contact__" + name][-1].wrench
            self.assertLess(numpy.abs(vector(wrench.force) - [0, 0, weight]).max(), 1e-3, name)
        self.assertAlmostEqual(wrench.torque.y, 0.5 * 3 * G, delta=1e-2)  # the force is 0.5 m before the sensor
        self.assertEqual(read["contact__below"][-1].header.frame_id, "below")

    def test_wrong_settings_end_the_node(self):
        for plugin, given, word in (("Imu", {}, "imu/sensors: names none"),
                                    ("Imu", {"imu/sensors": "a"}, "imu/a/body: is left out"),
                                    ("Imu", {"imu/sensors": "a", "imu/a/body": "b", "imu/a/gyroscope_noise": -1},
                                     "gyroscope_noise: must be a number >= 0"),
                                    ("Contact", {"contact/sensors": "a", "contact/a/body": "b",
                                                 "contact/a/position": "[0, 0]"}, "position: must be a list of 3 numbers")):
            command = node_command(plugins="constraint_sim/" + plugin, scene="none", **given)
            done = subprocess.run(command, stderr=subprocess.PIPE, universal_newlines=True, timeout=3 * TIMEOUT)
            self.assertEqual(done.returncode, 2, word)
            self.assertIn(word, done.stderr)


if __name__ == "__main__":
    rospy.init_node("test_sensors")
    rostest.rosrun("constraint_sim", "sensors", Sensors)
