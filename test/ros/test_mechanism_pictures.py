#!/usr/bin/env python3
"""Pictures of each shipped mechanism, of scenes of many contacts, and of each kind of joint, by rviz."""
import math
import os
import shutil
import subprocess

import numpy
import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import Point, Pose, TransformStamped, Vector3, Wrench
from visualization_msgs.msg import MarkerArray

import support
from in_rviz import PACKAGE, START, InRviz, read_view, shipped_configuration
from support import call

# Name or file below docs/images: middle of the picture [m], distance of the eye [m], simulated time [s],
# rotation about x [rad] that brings the mechanism into the upright x-z plane.
MECHANISMS = {
    "slider_crank": ((0.5, 0, 0.97), 1.3, 0.2, 0),
    "gear_train": ((0, 0, 1), 1.8, 0.6, 0),
    "universal_shaft": ((0, 0, 1.15), 1.5, 0.1, 0),
    "atwood": ((0.2, 0, 1.6), 2.4, 0.3, 0),
    "screw": ((0, 0, 1.98), 0.32, 0.5, 0),
    "peaucellier": ((0.65, 0, 1.6), 1.6, 0.3, 0),
    "squeezer": ((-0.03, 0.025, 0), 0.16, 0.005, math.pi / 2),
    "crane": ((0.6, 0, 1.5), 4.2, 2.0, 0),
    "gripper": ((0, 0, 0.94), 0.32, 1.0, 0),
    "stewart_platform": ((0, 0, 0.6), 3.0, 1.0, 0),
}
CONTACTS = {
    "pyramid": ((0, 0, 0.5), 2.4, 0.1, 0),
    "grasp": ((0, 0, 0.45), 1.4, 0.75, 0),
    "wrecking_ball": ((0, 0, 1.7), 6.0, 1.0, 0),
    "marble_run": ((0.18, 0, 0.6), 2.8, 2.6, 0),
}
# The quadruped stands on a floor, and is pushed.
ROBOTS = {"quadruped": ((0, 0, 0.22), 1.0, 0.6, 0)}
FLOOR = "bodies: [{name: floor, type: static, shape: {plane: {}}, friction: 1}]"
WIDTHS = {"joints.yaml": 1000, "stewart_platform": 900}  # widths of detailed pictures; else 720
JOINTS = {"joints.yaml": ((0.2, 0.7, 0.95), 5.0, 0.5, 0)}
# Distance in the configuration [m], and its factors by a click of the wheel.
DISTANCE, NEARER, FARTHER = 6.5, 0.88, 1.12


def from_the_front(names="false", legend="true"):
    """Returns the configuration of a view along y, without grid and frames. The picture's frame is placed
    as each scene needs."""
    text = shipped_configuration()
    for before, after in (("constraint_names: false", "constraint_names: " + names),
                          ("Fixed Frame: world", "Fixed Frame: picture"),
                          ("Name: Grid\n      Enabled: true", "Name: Grid\n      Enabled: false"),
                          ("Name: Frames\n      Enabled: true", "Name: Frames\n      Enabled: false"),
                          ("legend: true", "legend: " + legend),
                          ("Focal Point: {X: 0, Y: 0, Z: 1.2}", "Focal Point: {X: 0, Y: 0, Z: 0}"),
                          ("Pitch: 0.45\n      Yaw: 1.1\n    Saved", "Pitch: 0.3\n      Yaw: 4.9\n    Saved")):
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    return text


class Mechanisms(InRviz):
    """Each mechanism is drawn whole. With CONSTRAINT_SIM_SCREENSHOTS set to a folder the pictures of
    docs/images are left there, small enough for a page."""

    @classmethod
    def setUpClass(cls):
        cls.frames = tf2_ros.StaticTransformBroadcaster()
        super().setUpClass()

    def setUp(self):
        self.distance = DISTANCE
        self.labels = support.Listener(support.NODE + "/labels", MarkerArray)

    def tearDown(self):
        support.Listener.stop_all()

    def look(self, middle, distance, turn):
        frame = TransformStamped()
        frame.header.stamp = rospy.Time.now()
        frame.header.frame_id, frame.child_frame_id = "picture", "world"
        x, y, z = middle
        if turn == 0:  # room for the legend above it
            distance, z = 1.2 * distance, z + 0.08 * distance
        cosine, sine = math.cos(turn), math.sin(turn)
        shift, rotation = frame.transform.translation, frame.transform.rotation
        shift.x, shift.y, shift.z = -x, -(cosine * y - sine * z), -(sine * y + cosine * z)
        rotation.x, rotation.w = math.sin(0.5 * turn), math.cos(0.5 * turn)
        self.frames.sendTransform(frame)
        clicks = []
        while self.distance * NEARER > 0.94 * distance:
            clicks.append("4")
            self.distance *= NEARER
        while self.distance < 0.94 * distance:
            clicks.append("5")
            self.distance *= FARTHER
        subprocess.check_call(["xdotool", "mousemove", "60", "720"] +
                              [word for click in clicks for word in ("click", click)],
                              env=self.environment)

    def is_drawn(self, view):
        return numpy.abs(view - 48.0).max(axis=-1) > 20  # differs from the background

    def extent(self, view):
        """Returns the shares of the view's width and height with drawn elements."""
        is_drawn = self.is_drawn(view)
        return [numpy.ptp(numpy.flatnonzero(is_drawn.any(axis=axis))) / is_drawn.shape[1 - axis]
                if is_drawn.any() else 0.0 for axis in (0, 1)]

    def write_legend(self, name, texts):
        """Writes the legend of a lying mechanism: rviz would draw it in front of the scene."""
        path = self.screenshot(name)
        font = subprocess.check_output(["fc-match", "-f", "%{file}", "sans"])
        command = ["convert", path, "-gravity", "NorthWest", "-font", font, "-pointsize", "26"]
        lines = [marker for marker in texts.markers if marker.ns == "legend"]
        for row, line in enumerate(reversed(lines)):
            rgb = ",".join(str(round(255 * part)) for part in (line.color.r, line.color.g, line.color.b))
            command += ["-fill", "rgb(%s)" % rgb, "-annotate", "+60+%d" % (100 + 36 * row), line.text]
        subprocess.check_call(command + [path])

    def test_each_mechanism_is_drawn_whole(self):
        self.show_configuration(from_the_front())
        self.show({name: of for name, of in MECHANISMS.items() if of[-1] == 0})

    def test_scenes_of_many_contacts_are_drawn_whole(self):
        self.show_configuration(from_the_front())
        self.show(CONTACTS)

    def test_a_robot_on_its_feet_is_drawn_whole(self):
        self.show_configuration(from_the_front())
        self.show(ROBOTS)

    def load(self, scene, path):
        if scene not in ROBOTS:
            return call("load_scene", path=path)
        call("load_scene", text=FLOOR)
        answer = call("load_urdf", path=scene, pose=Pose(position=Point(z=0.31)))
        call("apply_body_wrench", body_name=answer.bodies[0], wrench=Wrench(force=Vector3(y=30)),
             start_time=rospy.Time(0), duration=rospy.Duration(-1))
        return answer

    def test_each_mechanism_that_lies_is_drawn_whole(self):
        """The legend would be in front of a lying mechanism, and is written at its edge."""
        self.show_configuration(from_the_front(legend="false"))
        self.show({name: of for name, of in MECHANISMS.items() if of[-1] != 0})

    def test_each_kind_of_joint_is_drawn_with_its_name(self):
        self.show_configuration(from_the_front(names="true"))
        self.show(JOINTS)

    def play(self, scene, picture):
        """Brings a scene into the empty view, at the time of its picture; returns its texts."""
        middle, distance, seconds, turn = picture
        support.empty_world()  # no body reacts to the wheel
        support.wait_until(lambda: self.extent(read_view(self.screenshot("empty.png"))) == [0, 0], "an empty view",
                           START)
        self.look(middle, distance, turn)
        answer = self.load(scene, os.path.join(PACKAGE, "docs/images", scene) if "." in scene else scene)
        self.assertTrue(answer.success, "%s: %s" % (scene, answer.status_message))
        tick = support.properties().time_step
        self.assertTrue(call("step", steps=round(seconds / tick)).success, scene)
        return self.labels.present(what="texts")  # texts are sent less often than moving markers

    def show(self, scenes):
        for scene, picture in scenes.items():
            name = scene.partition(".")[0] + ".png"
            texts = self.play(scene, picture)
            views = []

            def is_still():
                """Returns whether three views are equal and free of drawn elements at their borders: while rviz has
                not yet drawn the turns of the wheel, views are equal, too."""
                if self.has_restarted():
                    self.distance = DISTANCE
                    views.clear()
                    self.play(scene, picture)
                views.append(read_view(self.screenshot(name)))
                is_seen = self.is_drawn(views[-1])
                borders = (is_seen[0], is_seen[-1], is_seen[:, 0], is_seen[:, -1])
                return (len(views) > 2 and max(self.extent(views[-1])) > 0.3 and
                        not any(border.any() for border in borders) and
                        all((views[-1] == view).all() for view in views[-3:-1]))
            support.wait_until(is_still, "a whole picture of " + scene, START)
            if picture[-1] != 0:
                self.write_legend(name, texts)
            self.shrink(name, WIDTHS.get(scene, 720))


if __name__ == "__main__":
    if not shutil.which("xdotool"):
        raise SystemExit("xdotool is needed: scripts/setup")
    rospy.init_node("test_mechanism_pictures")
    rostest.rosrun("constraint_sim", "mechanism_pictures", Mechanisms)
