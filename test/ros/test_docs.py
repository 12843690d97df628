#!/usr/bin/env python3
"""Examples of the documentation have their documented effect, and are complete."""
import contextlib
import functools
import io
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

import roslaunch.arg_dump
import rospkg
import rospy
import rosservice
import rostest
import yaml
from actionlib_msgs.msg import GoalStatus
from sensor_msgs.msg import JointState
from visualization_msgs.msg import InteractiveMarkerUpdate

import control_messages  # noqa: F401  (before control_msgs)
import support
from control_msgs.msg import FollowJointTrajectoryActionResult
from support import NODE, call, node_command, properties, running

PACKAGE = rospkg.RosPack().get_path("constraint_sim")
OWN_ROBOT = "docs/tutorials/8_own_robot.md"
RUN_NODE = "rosrun constraint_sim constraint_sim_node "


def read_page(document):
    with open(os.path.join(PACKAGE, document)) as file:
        return file.read()


def pages(document):
    """Returns a document, and the pages in the folder of its name in the order of its links to them."""
    name = os.path.splitext(document)[0]
    links = re.findall(r"\(%s/(\w+\.md)" % os.path.basename(name), read_page(document))
    return [document] + [os.path.join(name, link) for link in dict.fromkeys(links)]


def read(document):
    """Returns the text of all pages of a document, in order."""
    return "\n".join(map(read_page, pages(document)))


def examples(document, *beginnings):
    """Returns the lines in code blocks and spans that begin with one of these words, in order."""
    blocks_and_spans = re.findall(r"^```\w*\n(.*?)^```|`([^`]+)`", read(document), re.M | re.S)
    lines = [line for block, span in blocks_and_spans
             for line in block.splitlines() or [" ".join(span.split())]]
    return [line for line in lines if line.startswith(beginnings)]


def is_refused(line):
    return line.endswith("# refused")


def first_column(table):
    """Returns the words in backticks in the first column of a Markdown table."""
    rows = re.findall(r"^\|([^|]*)\|", table, re.M)
    return {word for row in rows for word in re.findall(r"`([^`]+)`", row)}


def yaml_blocks(text):
    return re.findall(r"^```yaml\n(.*?)^```", text, re.M | re.S)


def exchanged_topics():
    publishers, subscribers, _ = rospy.get_master().getSystemState()[2]
    return {topic for topic, nodes in publishers + subscribers if NODE in nodes} - {"/rosout"}


def offered_services():
    _, _, services = rospy.get_master().getSystemState()[2]
    return {service for service, nodes in services if NODE in nodes
            and not service.endswith(("/get_loggers", "/set_logger_level"))}


def keys_in(value):
    """Returns all keys at any depth."""
    if isinstance(value, dict):
        return set(value).union(*map(keys_in, value.values()))
    return set().union(*map(keys_in, value)) if isinstance(value, list) else set()


def call_in_process(line):
    """Returns exit status and output of a `rosservice call`, whose own code runs here: a hundred processes would take
    a minute to start."""
    output, status = io.StringIO(), 0
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output), \
            unittest.mock.patch("rospy.init_node"):  # this process is a node
        try:
            rosservice.rosservicemain(shlex.split(line, comments=True))
        except SystemExit as end:
            status = end.code or 0
    return status, output.getvalue()


def call_unless_busy(line):
    """Returns what call_in_process does, or None where the edit before still runs, as on a busy machine."""
    done = call_in_process(line)
    return None if "not now: " in done[1] else done


def run(line, folder):
    """Returns exit status and output of a line in the shell."""
    if line.startswith("rosservice call") and not re.search(r"[|;&<>$`]", line):
        return support.wait_until(lambda: call_unless_busy(line), line)
    done = subprocess.run(["bash", "-c", line], stdout=subprocess.PIPE, cwd=folder, stderr=subprocess.STDOUT,
                          universal_newlines=True, timeout=support.TIMEOUT)
    return done.returncode, done.stdout


class Docs(unittest.TestCase):
    def check(self, line, folder):
        status, output = run(line, folder)
        is_error = is_refused(line) and (
            not line.startswith("rosservice call") or "/set_parameters " in line)
        self.assertEqual(status != 0, is_error, line + "\n" + output)
        if not line.startswith("rosservice call"):
            return
        if is_error:  # dynamic_reconfigure has no field for a rejection
            return
        answer = yaml.safe_load(output)  # empty for a service of type Empty
        if "/set_parameters " in line:
            self.assertIn("config", answer)
        elif answer is not None or is_refused(line):
            self.assertEqual(answer["success"], not is_refused(line), line + "\n" + output)

    def check_examples(self, document, node, least=6):
        lines = examples(document, "rosservice call", "rostopic", "rosparam",
                         "rosrun dynamic_reconfigure", "rosrun constraint_sim spawn")
        self.assertGreaterEqual(len(lines), least)
        with tempfile.TemporaryDirectory() as folder, running(node, cwd=folder):
            properties()  # the node is up
            for line in lines:
                self.check(line, folder)

    def test_the_examples_of_the_readme(self):
        self.check_examples("README.md", node_command(scene="bridge"))  # as in ./scripts/demo

    def test_the_examples_of_the_node(self):
        rospy.set_param("/use_sim_time", False)
        start = examples("docs/ros.md", RUN_NODE)[0]
        self.check_examples("docs/ros.md", node_command() + shlex.split(start)[3:])

    def test_the_examples_of_the_tutorials(self):
        rospy.set_param("/use_sim_time", False)
        folder = os.path.join(PACKAGE, "docs/tutorials")
        checked = 0
        for name in sorted(os.listdir(folder)):
            document = os.path.join("docs/tutorials", name)
            start = examples(document, RUN_NODE)
            if start and document != OWN_ROBOT:
                self.check_examples(document, node_command() + shlex.split(start[0])[3:], least=1)
                checked += 1
        self.assertEqual(checked, 6)

    def test_the_tutorial_of_an_own_robot(self):
        """From the URDF to the grasp: each line, and what it shows."""
        rospy.set_param("/use_sim_time", False)
        hold, start, *lines = examples(OWN_ROBOT, "rosrun", "rosservice", "rostopic")
        with tempfile.TemporaryDirectory() as folder:
            os.symlink(os.path.join(PACKAGE, "examples"), os.path.join(folder, "examples"))
            status, output = run(hold, folder)
            self.assertEqual((status, output.count(" holds ")), (0, 3), output)
            with running(node_command() + shlex.split(start)[3:], cwd=folder), unittest.mock.patch.dict(
                    os.environ, PYTHONPATH=":".join(sys.path)):  # control_msgs may be a copy of the tests
                properties()
                self.type_tutorial(lines, folder)

    def type_tutorial(self, lines, folder):
        """Types the lines for a running node, each motion until its end, and checks what they show."""
        goal = NODE + "/robots/picker/follow_joint_trajectory/"
        results = support.Listener(goal + "result", FollowJointTrajectoryActionResult).messages
        joints = support.Listener(NODE + "/robots/picker/joint_states", JointState).messages
        position = lambda joint: joints[-1].position[joints[-1].name.index(joint)]
        is_near = lambda place, *of_exact: max(abs(place[k] - x) for k, x in zip("xyz", of_exact)) < 2e-3
        arrivals = iter([lambda: results and results[0].status.status == GoalStatus.SUCCEEDED,
                         lambda: abs(position("left_finger") - 0.035) < 1e-3,  # the box is in the way
                         lambda: abs(position("lift") - 0.25) + abs(position("turn") - 1.2) < 1e-4])
        expected = {"status": lambda shown: shown["status_list"][0]["status"] == GoalStatus.SUCCEEDED,
                    "joint_states": lambda shown: abs(shown["position"][shown["name"].index("lift")]) < 1e-4,
                    "contact_forces": lambda shown: {c["body_a"] for c in shown["contacts"]} >= {"left/com", "arm/com"},
                    "get_body_state": lambda shown: is_near(shown["state"]["pose"]["position"], 0.1631, 0.4194, 0.28),
                    "verify": lambda shown: shown["verdicts"][shown["bodies"].index("box")] == "holds",
                    "statistics": lambda shown: shown["max_constraint_error"] < 1e-3}
        for line in lines:
            if line.startswith("rostopic pub"):
                self.check(line, folder)
            else:
                shown = self.shown(line, folder)
                is_as_told = expected.pop(re.search(r"/(\w+)(?: '|$)", line)[1], lambda answer: answer["success"])
                self.assertTrue(is_as_told(shown), line + "\n" + str(shown))
            if line.startswith("rostopic pub") or "set_motor_bias" in line:
                support.wait_until(next(arrivals), line)
        self.assertEqual((expected, list(arrivals)), ({}, []))

    def test_the_examples_of_robots(self):
        rospy.set_param("/use_sim_time", False)
        start = examples("docs/robots.md", RUN_NODE)[0]
        self.check_examples("docs/robots.md", node_command() + shlex.split(start)[3:])
        blocks = [block for block in yaml_blocks(read("docs/robots.md"))
                  if "controller_list" not in block]  # MoveIt's
        self.assertEqual(len(blocks), 1)
        with running(node_command()):
            answer = call("load_urdf", path="arm", extra=blocks[0])
            self.assertTrue(answer.success, answer.status_message)

    def test_the_examples_of_sensors(self):
        """The robot stands after a moment: its trunk feels gravity, and a foot carries a part of its weight."""
        rospy.set_param("/use_sim_time", False)
        start = examples("docs/sensors.md", RUN_NODE)[0]
        imu, foot, belly, scan = examples("docs/sensors.md", "rostopic")
        with tempfile.TemporaryDirectory() as folder, running(node_command() + shlex.split(start)[3:], cwd=folder):
            properties()
            for line in examples("docs/sensors.md", "rosservice call"):
                self.check(line, folder)
            upwards = lambda line, *keys: functools.reduce(dict.get, keys, self.shown(line, folder))["z"]
            support.wait_until(lambda: abs(upwards(imu, "linear_acceleration") - 9.81) < 0.1, imu)
            support.wait_until(lambda: 5 < upwards(foot, "wrench", "force") < 100, foot)
            self.assertAlmostEqual(self.shown(belly, folder)["range"], 0.3, delta=0.05)
            ranges = [float(text) for text in self.shown(scan, folder)["ranges"]]  # YAML has .inf, rostopic inf
            self.assertAlmostEqual(ranges[2], 1.9, delta=0.05)
            self.assertEqual(ranges[:2] + ranges[3:], [math.inf] * 4)

    def shown(self, line, folder):
        """Returns the message that a `rostopic echo` of the documentation shows."""
        status, output = run(line, folder)
        self.assertEqual(status, 0, output)
        return next(yaml.safe_load_all(output))

    def test_each_service_and_topic_has_an_example_and_a_row_and_exists(self):
        calls = "\n".join(examples("docs/ros.md", "rosservice call", "rostopic"))
        used = re.findall(r"^ros\w+ (?:call|echo -n 1|pub -1) (\S+)", calls, re.M)
        of_any_constraint = lambda names: {
            re.sub("/force_torque/.*", "/force_torque/<constraint>", name) for name in names}
        used = of_any_constraint(used)
        with running(node_command(publish_clock="true", scene="pendulum")):
            properties()
            support.wait_until(lambda: any("force_torque" in t for t in exchanged_topics()),
                               "the topic of a constraint")
            support.Listener(NODE + "/hands/update", InteractiveMarkerUpdate)  # a viewer
            support.wait_until(lambda: NODE + "/hands/feedback" in exchanged_topics(),
                               "the topics of hands")
            self.assertEqual(used, of_any_constraint(offered_services() | exchanged_topics()))
        rows = {rospy.names.ns_join(NODE, name) for name in first_column(read("docs/ros.md"))}
        self.assertLessEqual(used, rows)

    def test_each_parameter_has_an_example_and_exists(self):
        given = re.findall(r" _(\w+):=", "\n".join(examples("docs/ros.md", RUN_NODE)))
        self.assertEqual(set(given), set(yaml.safe_load(read("config/parameters.yaml"))))

    def test_the_examples_of_parameters(self):
        for line in examples("docs/ros.md", RUN_NODE):
            command = shlex.split(line, comments=True)
            if is_refused(line):
                self.assertEqual(subprocess.call(command, timeout=support.TIMEOUT), 2, line)
                continue
            with running(command + ["__name:=example"]):
                self.assertTrue(call("/example/get_world_properties").success)
                for name, value in re.findall(r" _(\w+):=(\S+)", line):
                    self.assertEqual(rospy.get_param("/example/" + name), yaml.safe_load(value))

    def test_the_examples_of_launch_files_have_only_arguments_that_exist(self):
        lines = examples("docs/ros.md", "roslaunch constraint_sim")
        files = {line.split()[2] for line in lines}
        self.assertEqual(files, set(os.listdir(os.path.join(PACKAGE, "launch"))))
        for line in lines:
            _, _, file, *arguments = shlex.split(line, comments=True)
            declared = roslaunch.arg_dump.get_args([os.path.join(PACKAGE, "launch", file)])
            self.assertLessEqual({a.split(":=")[0] for a in arguments}, set(declared), line)

    # ---- scenes

    def test_the_examples_of_scenes_are_accepted(self):
        for text in yaml_blocks(read("docs/scenes.md")):
            with tempfile.NamedTemporaryFile("w", suffix=".yaml") as scene:
                scene.write(text)
                scene.flush()
                done = subprocess.run(["rosrun", "constraint_sim", "constraint_sim_run",
                                       scene.name, "--duration", "0"], stdout=subprocess.PIPE,
                                      stderr=subprocess.STDOUT, universal_newlines=True)
            self.assertEqual(done.returncode, 0, text + done.stdout)

    def test_each_key_of_scenes_has_an_example(self):
        scenes, *others = map(read_page, pages("docs/scenes.md"))
        sections = re.split(r"^### ", scenes, flags=re.M)[1:] + others
        self.assertGreaterEqual(len(sections), 5)  # the sections were found
        for section in sections:
            shown = set()
            for scene in map(yaml.safe_load, yaml_blocks(section)):
                # types of constraints have rows too, and occur as values
                types = {c.get("type") for c in scene.get("constraints", [])}
                shown |= keys_in(scene) | types
            # types of plugins have examples that need one (docs/plugins.md, test_plugins)
            missing = first_column(section) - shown - {"custom", "custom_force"}
            self.assertEqual(missing, set(), section.splitlines()[0])


if __name__ == "__main__":
    rospy.init_node("test_docs")
    rostest.rosrun("constraint_sim", "docs", Docs)
