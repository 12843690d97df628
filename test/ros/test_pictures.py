#!/usr/bin/env python3
"""What rviz draws, in its shipped configuration."""
import os

import numpy
import rospy
import rostest

import support
from in_rviz import PACKAGE, START, InRviz, read_view, shipped_configuration
from support import call

# as they are drawn, not shaded
SEEN = {"a taut rope or rod": (26, 217, 255), "compression": (255, 230, 26), "a motor": (255, 102, 217),
        "contact forces": (255, 255, 255), "a slack rope": (191, 173, 140)}


class Pictures(InRviz):
    """The shipped configuration shows a scene with one of each kind of constraint."""

    configuration = staticmethod(shipped_configuration)

    def test_each_sign_is_seen(self):
        path = os.path.join(PACKAGE, "docs/images/kinds.yaml")
        answer = call("load_scene", path=path)
        self.assertTrue(answer.success, answer.status_message)
        call("unpause_physics")

        def missing():
            view = read_view(self.screenshot("kinds.png"))
            # some lines of it; a legend that is written in its colour has fewer such pixels
            counts = {sign: int((numpy.abs(view - colour).max(axis=-1) < 12).sum())
                      for sign, colour in SEEN.items()}
            return [sign for sign, count in counts.items() if count < 25]
        try:
            support.wait_until(lambda: not missing(), "all signs", START)
        finally:
            call("pause_physics")
        self.assertEqual(missing(), [])


if __name__ == "__main__":
    rospy.init_node("test_pictures")
    rostest.rosrun("constraint_sim", "pictures", Pictures)
