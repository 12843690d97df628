#!/usr/bin/env python3
"""The shipped sensors, constraint_sim/Imu, Contact, Range and Laser, against closed forms."""
import math
import subprocess

import numpy
import rospy
import rostest
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import Imu, LaserScan, Range

import support
from support import NODE, TIMEOUT, node_command, properties, running, wait_until

H = 0.01
G = 9.81
RATE = 2.0  # rate of the table [rad/s]
SCENE = """
world: {time_step: 0.01}
bodies:
  - {name: floor, type: static, shape: {plane: {}}, friction: 1}
  - {name: table, type: kinematic, position: [5, 0, 1], angular_velocity: [0, 0, 2]}
  - {name: ball, mass: 1, position: [0, 5, 1000]}
  - {name: box, mass: 2, shape: {box: {size: [1, 1, 1]}}, position: [0, 0, 0.5], friction: 1}
  - {name: lid, mass: 1, shape: {box: {size: [1, 1, 1]}}, position: [0, 0, 1.5], friction: 1}
"""

# A cart at constant speed along x, before a wall at x = 10 and beside a ball of 0.5 m at (3, 4).
SPEED = 1.0  # [m/s]
ROOM = """
world: {time_step: 0.01, gravity: [0, 0, 0]}
bodies:
  - {name: cart, type: kinematic, shape: {box: {size: [0.6, 0.4, 0.2]}}, linear_velocity: [1, 0, 0]}
  - {name: wall, type: static, shape: {box: {size: [2, 40, 40]}}, position: [11, 0, 0]}
  - {name: ball, type: static, shape: {sphere: {radius: 0.5}}, position: [3, 4, 0]}
  - {name: mast, type: kinematic, shape: {cylinder: {radius: 0.05, length: 1}}, position: [0.5, 0, 0], linear_velocity: [1, 0, 0]}
"""


def in_the_room(x, angle, reach):
    """Returns the range along a beam in the plane z = 0 from (x, 0), by circle and line; without the mast."""
    found = math.inf
    if math.cos(angle) > 0:
        found = (10 - x) / math.cos(angle)
    along = (3 - x) * math.cos(angle) + 4 * math.sin(angle)
    square = 0.25 - ((3 - x) ** 2 + 16 - along ** 2)
    if square > 0 and along > 0:
        found = min(found, along - math.sqrt(square))
    return found if found <= reach else math.inf


def vector(message):
    return numpy.array([message.x, message.y, message.z])


class Sensors(support.ServiceCase):
    def node(self, plugin, **parameters):
        return running(node_command(plugins="constraint_sim/" + plugin, scene="none", paused="true", **parameters))

    def read(self, steps, count, scene=SCENE, **topics):
        """Steps the world; returns the messages of each topic, `count` of each. A scene of None stays."""
        if scene:
            self.good("load_scene", text=scene)
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

    def test_lasers_and_range_sensors_read_the_geometry(self):
        """Ranges have 24 bits of mantissa: 1e-6 of them is 16 of their roundings. Of the cone of 0.2 rad the axis is
        nearest to the wall."""
        given = {"laser/sensors": "scan seeing", "laser/scan/body": "cart", "laser/scan/ignore": "mast nobody",
                 "laser/scan/angle_min": -3.0, "laser/scan/angle_max": 3.0, "laser/scan/samples": 601,
                 "laser/scan/range_max": 9.9, "laser/seeing/body": "cart", "laser/seeing/samples": 3,
                 "laser/seeing/range_min": 0.46, "laser/seeing/rate": 4,
                 "range/sensors": "ahead cone down inside", "range/ahead/body": "mast",
                 "range/cone/body": "mast", "range/cone/field_of_view": 0.2, "range/cone/radiation": "ultrasound",
                 "range/down/body": "cart", "range/down/orientation": "[0, 0.7071067811865476, 0, 0.7071067811865476]",
                 "range/inside/body": "cart", "range/inside/position": "[0.5, 0, 0]"}
        with self.node("Range constraint_sim/Laser", **given):
            properties()
            read = self.read(50, 50, ROOM, laser__scan=LaserScan, range__ahead=Range, range__cone=Range,
                             range__down=Range, range__inside=Range)
            slow = self.read(100, 4, ROOM, laser__seeing=LaserScan)["laser__seeing"]
        seen = {"wall": 0, "ball": 0, "nothing": 0}
        for k, scan in enumerate(read["laser__scan"]):
            self.assertEqual((len(scan.ranges), scan.header.frame_id, scan.time_increment), (601, "scan", 0.0))
            self.assertAlmostEqual(scan.angle_increment, 0.01, delta=1e-8)
            self.assertAlmostEqual(scan.scan_time, H, delta=1e-8)
            x = SPEED * H * (k + 1)  # at the end of the step
            for i, found in enumerate(scan.ranges):
                angle = -3.0 + 0.01 * i
                expected = in_the_room(x, angle, 9.9)
                off = math.hypot(3 - x, 4) * math.sin(math.atan2(4, 3 - x) - angle)
                if abs(in_the_room(x, angle, 99) - 9.9) < 1e-5 or abs(abs(off) - 0.5) < 1e-5:
                    continue  # the limit, or the edge of the ball, within rounding
                if math.isinf(expected):
                    self.assertEqual(found, math.inf, (k, i))
                else:
                    self.assertAlmostEqual(found, expected, delta=1e-6 * expected, msg=(k, i))
                seen["nothing" if math.isinf(expected) else "ball" if angle > 0.5 else "wall"] += 1
        self.assertGreater(min(seen.values()), 1000, seen)
        for k, (ahead, cone) in enumerate(zip(read["range__ahead"], read["range__cone"])):
            expected = 10 - (0.5 + SPEED * H * (k + 1))
            for message in (ahead, cone):
                self.assertAlmostEqual(message.range, expected, delta=1e-6 * expected)
        self.assertEqual((cone.radiation_type, ahead.radiation_type), (Range.ULTRASOUND, Range.INFRARED))
        self.assertAlmostEqual(cone.field_of_view, 0.2, delta=1e-7)
        self.assertEqual((cone.min_range, cone.max_range), (0.0, 30.0))
        self.assertEqual({m.range for m in read["range__down"]}, {math.inf})
        self.assertEqual({m.range for m in read["range__inside"]}, {-math.inf})  # within the mast
        # The mast is 0.45 m ahead, nearer than the least range; 4 scans a second, at multiples of 0.25 s.
        self.assertEqual([round(b, 6) for scan in slow for b in scan.ranges[1:2]], [-math.inf] * 4)
        gaps = [(b.header.stamp - a.header.stamp).to_sec() for a, b in zip(slow, slow[1:])]
        self.assertAlmostEqual(slow[0].scan_time, 0.25, delta=1e-7)
        self.assertGreater(min(gaps), 0.0)

    def test_noise_of_ranges_is_of_the_seed(self):
        """The deviation of 36200 readings is off by 1/√72400 of itself in one of three cases: 2 % is 5 times as much.
        A run from a snapshot, and a second node, have equal readings."""
        given = {"laser/sensors": "one same other", "range/sensors": "beam", "range/beam/body": "cart",
                 "range/beam/noise": 0.05, "range/beam/ignore": "mast", "range/beam/rate": 30}
        for name in ("one", "same", "other"):
            given.update({"laser/%s/%s" % (name, key): value for key, value in dict(
                body="cart", noise=0.02, ignore="mast", seed=7 if name == "other" else 3, angle_min=-1.0,
                angle_max=0.5, range_max=11.0).items()})
        topics = dict(laser__one=LaserScan, laser__same=LaserScan, laser__other=LaserScan)
        runs = []
        for _ in range(2):
            with self.node("Range constraint_sim/Laser", **given):
                properties()
                self.good("load_scene", text=ROOM)
                self.good("step", steps=7)
                self.good("save_snapshot", name="start")
                read = self.read(200, 200, None, **topics)
                runs.append({name: numpy.array([m.ranges for m in read["laser__" + name]])
                             for name in ("one", "same", "other")})
                beams = []
                for _ in range(2):
                    self.good("restore_snapshot", name="start")
                    beams.append([m.range for m in self.read(100, 30, None, range__beam=Range)["range__beam"]])
                self.good("restore_snapshot", name="start")
                again = self.read(200, 200, None, laser__one=LaserScan)["laser__one"]
                self.assertEqual(beams[0], beams[1])
                self.assertTrue((numpy.array([m.ranges for m in again]) == runs[-1]["one"]).all())
        first = runs[0]["one"]
        self.assertTrue((first == runs[0]["same"]).all())
        self.assertTrue((first == runs[1]["one"]).all())
        self.assertEqual(beams, [beams[0]] * 2)
        self.assertGreater((first != runs[0]["other"])[numpy.isfinite(first)].mean(), 0.99)
        angles = numpy.linspace(-1.0, 0.5, 181)
        x = SPEED * H * (8 + numpy.arange(200))
        exact = (10 - x)[:, None] / numpy.cos(angles)[None, :]
        inner = exact < 10.8  # ten deviations below the limit, which noise does not cross
        off = (first - exact)[inner]
        self.assertGreater(off.size, 20000)
        self.assertLess(abs(off.std() / 0.02 - 1), 0.02)
        self.assertLess(abs(off.mean()), 5 * 0.02 / math.sqrt(off.size))
        self.assertTrue((first[exact > 11.0 + 1e-5] == numpy.inf).all())
        self.assertTrue((first[numpy.isfinite(first)] <= numpy.float32(11.0)).all())

    def test_wrong_settings_end_the_node(self):
        for plugin, given, word in (("Imu", {}, "imu/sensors: names none"),
                                    ("Imu", {"imu/sensors": "a"}, "imu/a/body: is left out"),
                                    ("Imu", {"imu/sensors": "a", "imu/a/body": "b", "imu/a/gyroscope_noise": -1},
                                     "gyroscope_noise: must be a number >= 0"),
                                    ("Laser", {"laser/sensors": "a", "laser/a/body": "b", "laser/a/samples": 1},
                                     "laser/a/samples: must be a whole number from 2 to 10000, got 1"),
                                    ("Laser", {"laser/sensors": "a", "laser/a/body": "b", "laser/a/angle_min": 2},
                                     "laser/a/angle_max: must exceed angle_min"),
                                    ("Laser", {"laser/sensors": "a", "laser/a/body": "b", "laser/a/noise": "much"},
                                     "laser/a/noise: must be a number"),
                                    ("Range", {"range/sensors": "a", "range/a/body": "b", "range/a/range_min": 40},
                                     "range/a/range_max: must exceed range_min"),
                                    ("Range", {"range/sensors": "a", "range/a/body": "b", "range/a/radiation": "light"},
                                     "range/a/radiation: must be infrared or ultrasound, got 'light'"),
                                    ("Contact", {"contact/sensors": "a", "contact/a/body": "b",
                                                 "contact/a/position": "[0, 0]"}, "position: must be a list of 3 numbers")):
            command = node_command(plugins="constraint_sim/" + plugin, scene="none", **given)
            done = subprocess.run(command, stderr=subprocess.PIPE, universal_newlines=True, timeout=3 * TIMEOUT)
            self.assertEqual(done.returncode, 2, word)
            self.assertIn(word, done.stderr)


if __name__ == "__main__":
    rospy.init_node("test_sensors")
    rostest.rosrun("constraint_sim", "sensors", Sensors)
