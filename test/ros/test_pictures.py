#!/usr/bin/env python3
"""Pictures by rviz, in the view of each scene."""
import os

import numpy
import rospy
import rostest

import support
from in_rviz import PACKAGE, START, InRviz, fitted_configuration, read_view
from support import call
from visualization_msgs.msg import MarkerArray

# colours as drawn, unshaded
TENSION, COMPRESSION, SLACK = (26, 217, 255), (255, 230, 26), (191, 173, 140)
MOTOR, LIMITED, CONTACT = (255, 102, 217), (191, 51, 140), (255, 255, 255)
FRICTION = (144, 125, 179)  # sticking friction, seen through a half opaque floor
RED = (226, 64, 57)  # drawn by shaded rods
BELOW = 230  # rows of the view below the legend, whose texts have these colours

SLIDING = (255, 153, 51)  # sliding friction
STUCK = (191, 153, 255)
BROKEN = (166, 166, 166)

# Event-driven scenes: number of steps before their pictures, and shown colours.
EVENTS = {"safety_rope": (75, [TENSION, BROKEN]), "breaking_rod": (50, [BROKEN]),
          "rocking_block": (40, [CONTACT, STUCK]), "newtons_cradle": (95, [TENSION]),
          "ball_on_incline": (10, [CONTACT, SLIDING]),
          "weak_winch": (140, [TENSION, LIMITED, CONTACT, SLIDING])}


class Pictures(InRviz):
    """With CONSTRAINT_SIM_SCREENSHOTS set to a folder the pictures of docs/images are left there."""

    def show(self, name, scene, signs, steps=None, filled=0.0):
        """Waits until the picture of a scene, running or after these steps, has these signs and bodies
        over this share of its width or height."""
        path = os.path.join(PACKAGE, "docs/images", scene) if "." in scene else scene
        views = []

        def play():
            answer = call("load_scene", path=path)
            self.assertTrue(answer.success, answer.status_message)
            if steps is None:
                call("unpause_physics")
            labels = support.Listener(support.NODE + "/labels", MarkerArray)
            labels.present(what="texts")  # texts are sent less often than moving markers
            if steps:  # from a completely drawn state
                self.assertTrue(call("step", steps=steps).success)
                labels = support.Listener(support.NODE + "/labels", MarkerArray)
                texts = ["grey, in two parts: broken"] if BROKEN in signs else []
                labels.present(lambda m: set(texts) <= {x.text for x in m.markers}, "texts of now")

        def missing():
            if self.has_restarted():
                views.clear()
            if len(views) % 4 == 0 and (not views or BROKEN in signs):  # shown for two seconds
                play()
            views.append(read_view(self.screenshot(name)))
            counts = {sign: int((numpy.abs(views[-1][BELOW:] - sign).max(axis=-1) < 12).sum())
                      for sign in signs}
            share = max(self.filled(views[-1], 0), self.filled(views[-1], 1))
            if BROKEN in signs:
                is_settled = len(views) % 4 > 1
            else:  # three equal views, except for the largest forces of the last seconds
                is_settled = steps is None or (
                    len(views) > 2 and
                    all((views[-1][BELOW:] == view[BELOW:]).all() for view in views[-3:-1]))
            return ([sign for sign, count in counts.items() if count < 25] or not share > filled or
                    not is_settled)
        support.empty_world()
        self.show_configuration(fitted_configuration(path))
        try:
            support.wait_until(lambda: not missing(), "all signs", START)
        finally:
            call("pause_physics")
            support.Listener.stop_all()

    def test_kinds_of_constraints(self):
        self.show("kinds.png", "kinds.yaml", [TENSION, COMPRESSION, SLACK, MOTOR, CONTACT, RED])
        self.shrink("kinds.png", 1000, 1.35)

    def test_scenes_with_events(self):
        for scene, (steps, signs) in EVENTS.items():
            self.show(scene + ".png", scene, signs, steps=steps, filled=0.02)
            self.shrink(scene + ".png", 720, 1.15 if scene == "ball_on_incline" else 1)

    def test_contact_forces(self):
        self.show("contact_forces.png", "slope.yaml", [CONTACT, FRICTION], steps=60)
        self.shrink("contact_forces.png", 800, 2)

    def filled(self, view, axis):
        """Returns the share of the view's height (axis 1) or width (0) with drawn bodies."""
        is_blue = view[..., 2] - view[..., 0] > 30
        seen = numpy.flatnonzero(is_blue.any(axis=axis))
        return numpy.ptp(seen) / view.shape[1 - axis] if seen.size else 0.0

    def test_a_small_scene_fills_the_view(self):
        self.show("view_small.png", "gripper", [], steps=0, filled=0.3)

    def test_a_large_scene_fills_the_view(self):
        """A chain of 100 m, seen at an angle, fills the view."""
        scene = os.path.join(self.folder, "chain.yaml")
        with open(scene, "w") as file:
            file.write("bodies:\n" + "".join(
                "- {name: b%d, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}, position: [%g, 0, 0]}\n" %
                (i, i + 0.5) for i in range(100)))
            file.write("constraints:\n- {name: j0, type: ball, body_b: b0, anchor_b: [-0.5, 0, 0]}\n" +
                       "".join("- {name: j%d, type: ball, body_a: b%d, anchor_a: [0.5, 0, 0], body_b: b%d, "
                               "anchor_b: [-0.5, 0, 0]}\n" % (i, i - 1, i) for i in range(1, 100)))
        self.show("view_large.png", scene, [], steps=0, filled=0.5)


if __name__ == "__main__":
    rospy.init_node("test_pictures")
    rostest.rosrun("constraint_sim", "pictures", Pictures)
