#!/usr/bin/env python3
"""No call over a connection of its own is lost, also where roscpp is delayed until it loses one of five."""
import os
import pathlib
import subprocess
import tempfile
import threading
import unittest

import rospy
import rostest
from constraint_sim.srv import GetBodyState

from support import NODE, node_command, properties, running

CLIENTS = 6
CALLS = 60  # calls of each client


class LostCalls(unittest.TestCase):
    def test_a_delayed_node_answers_every_call(self):
        lost = []

        def ask():
            proxy = rospy.ServiceProxy(NODE + "/get_body_state", GetBodyState)
            for _ in range(CALLS):
                try:
                    if not proxy(name="bob").success:
                        lost.append("refused")
                except rospy.ServiceException as error:
                    lost.append(str(error))

        with tempfile.TemporaryDirectory() as folder:
            library = folder + "/slow_polling.so"
            subprocess.check_call(["cc", "-shared", "-fPIC",
                                   str(pathlib.Path(__file__).with_name("slow_polling.c")), "-o", library, "-ldl"])
            with running(node_command(scene="pendulum"), env=dict(os.environ, LD_PRELOAD=library)):
                properties()
                threads = [threading.Thread(target=ask) for _ in range(CLIENTS)]
                for thread in threads:
                    thread.start()
                for thread in threads:
                    thread.join()
        self.assertEqual(lost, [])


if __name__ == "__main__":
    rospy.init_node("lost_calls")
    rostest.rosrun("constraint_sim", "lost_calls", LostCalls)
