#!/usr/bin/env python3
"""Action servers of robots, by actionlib's client, with goals as MoveIt sends them."""
import contextlib
import threading

import actionlib
import rospy
import rostest
from actionlib_msgs.msg import GoalID, GoalStatus
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import control_messages  # noqa: F401  (before control_msgs)
import support
from control_msgs.msg import (FollowJointTrajectoryAction, FollowJointTrajectoryGoal, FollowJointTrajectoryResult,
                              JointTolerance)
from support import NODE, Listener, node_command, properties, running, wait_until

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
START = [0.0, -1.2, 1.5, 0.0, 0.0, 0.0]  # config/robots/arm.yaml
END = [0.4, -0.9, 1.2, 0.3, -0.2, 0.5]
TIMEOUT = rospy.Duration(support.TIMEOUT)
# control_msgs 1.5 of Noetic; with other sums no client would connect
SUMS = {"FollowJointTrajectoryAction": "bc4f9b743838566551c0390c65f1a248",
        "FollowJointTrajectoryActionGoal": "cff5c1d533bf2f82dd0138d57f4304bb",
        "FollowJointTrajectoryActionResult": "c4fb3b000dc9da4fd99699380efcc5d9",
        "FollowJointTrajectoryActionFeedback": "d8920dc4eae9fc107e00999cce4be641"}
Result = FollowJointTrajectoryResult


def action_name(robot):
    return "%s/robots/%s/follow_joint_trajectory" % (NODE, robot)


def point(time, positions, velocities=(), accelerations=()):
    return JointTrajectoryPoint(positions=positions, velocities=velocities, accelerations=accelerations,
                                time_from_start=rospy.Duration(time))


def goal(points, joints=None, **fields):
    trajectory = JointTrajectory(joint_names=JOINTS if joints is None else joints, points=points)
    trajectory.header.frame_id = "base_link"  # as MoveIt has it
    return FollowJointTrajectoryGoal(trajectory=trajectory, **fields)


def middle(a, b):
    return [0.5 * (x + y) for x, y in zip(a, b)]


class Client(actionlib.SimpleActionClient):
    """Holds answers until send_goal() has noted its goal: actionlib drops those that come before."""

    def __init__(self, name):
        self.sending = threading.RLock()
        super().__init__(name, FollowJointTrajectoryAction)

    def send_goal(self, *goal, **callbacks):
        with self.sending:
            super().send_goal(*goal, **callbacks)

    def _handle_transition(self, handle):
        with self.sending:
            super()._handle_transition(handle)


class Actions(support.ServiceCase):
    def tearDown(self):
        Listener.stop_all()

    @contextlib.contextmanager
    def arm(self, extra="", **parameters):
        """Runs a node with the arm, which has the motors of `extra`; gives a client of its action."""
        with running(node_command(scene="none", **parameters)):
            self.good("load_urdf", path="arm", fixed=True, extra=extra)
            yield self.client("arm")

    def client(self, robot):
        client = Client(action_name(robot))
        self.assertTrue(client.wait_for_server(TIMEOUT), robot)
        return client

    def positions(self):
        state = Listener(NODE + "/joint_states", JointState).present()
        return dict(zip(state.name, state.position))

    def is_at(self, end, delta):
        positions = self.positions()
        return all(abs(positions[joint] - x) <= delta for joint, x in zip(JOINTS, end))

    def expect(self, client, status, code, *words):
        """Waits for the result of the client's goal."""
        self.assertTrue(client.wait_for_result(TIMEOUT))
        result = client.get_result()
        self.assertEqual((client.get_state(), result.error_code), (status, code), result.error_string)
        for word in words:
            self.assertIn(word, result.error_string)

    def step_until_done(self, client):
        def is_done():
            self.good("step", steps=10)
            return client.wait_for_result(rospy.Duration(0.01))
        wait_until(is_done, "a result")

    def test_types_are_those_of_control_msgs(self):
        import control_msgs.msg
        for name, expected in SUMS.items():
            self.assertEqual(getattr(control_msgs.msg, name)._md5sum, expected, name)

    def test_goals_in_the_forms_of_moveit_succeed(self):
        zeros = [0.0] * 6
        off = [x + 2e-3 for x in START]
        speed = [(b - a) / 1.0 for a, b in zip(START, END)]
        forms = {
            "all": [point(0, START, zeros, zeros), point(0.5, middle(START, END), speed, zeros),
                    point(1, END, zeros, zeros)],
            "velocities": [point(0, START, zeros), point(0.5, middle(START, END), speed), point(1, END, zeros)],
            "positions": [point(0, START), point(0.5, middle(START, END)), point(1, END)],
            "off": [point(0, off, zeros, zeros), point(1, END, zeros, zeros)],
            "no first": [point(1, END, zeros)]}
        for name, points in forms.items():
            with self.arm(real_time_factor=0, command=" ".join(JOINTS)) as client:
                client.send_goal(goal(points))
                self.expect(client, GoalStatus.SUCCEEDED, Result.SUCCESSFUL)
                # held to rounding; a rate that jumps to 0 takes a limited motor beyond the end, within goal_tolerance
                delta = 0.01 if name == "positions" else 1e-9
                wait_until(lambda: self.is_at(END, delta), name)
                if name != "all":
                    continue
                # a plan that stays, as MoveIt sends it
                client.send_goal(goal([point(0, END, zeros, zeros)]))
                self.expect(client, GoalStatus.SUCCEEDED, Result.SUCCESSFUL)
                # two joints, in another order; the others stay
                client.send_goal(goal([point(0, [1.2, 0.4], [0, 0]), point(0.5, [1.0, 0.1], [0, 0])],
                                      ["elbow", "shoulder_pan"]))
                self.expect(client, GoalStatus.SUCCEEDED, Result.SUCCESSFUL)
                wait_until(lambda: self.is_at([0.1] + END[1:2] + [1.0] + END[3:], 1e-9), "two joints")
                # no points: the joints stop where they are
                client.send_goal(goal([]))
                self.expect(client, GoalStatus.SUCCEEDED, Result.SUCCESSFUL)

    def test_invalid_goals_are_rejected_with_their_code(self):
        with self.arm(paused=True) as client:
            self.good("load_urdf", path="gripper", fixed=True, pose=at(5.0))
            before = properties().state_hash

            def expect(code, word, bad):
                client.send_goal(bad)
                self.expect(client, GoalStatus.REJECTED, code, word)
                self.assertEqual(properties().state_hash, before)
            expect(Result.INVALID_JOINTS, "no joint 'knee'", goal([point(1, [0.0])], ["knee"]))
            expect(Result.INVALID_JOINTS, "no joint 'lift'", goal([point(1, [0.0])], ["lift"]))  # the gripper's joint
            expect(Result.INVALID_JOINTS, "there are none", goal([point(1, [])], []))
            expect(Result.INVALID_JOINTS, "twice", goal([point(1, [0, 0])], ["elbow", "elbow"]))
            expect(Result.INVALID_JOINTS, "goal_tolerance: joint 'knee'",
                   goal([point(1, END)], goal_tolerance=[JointTolerance(name="knee")]))
            expect(Result.INVALID_GOAL, "finite",
                   goal([point(1, END)], path_tolerance=[JointTolerance(name="elbow", position=float("nan"))]))
            expect(Result.INVALID_GOAL, "points[1].time_from_start", goal([point(1, END), point(1, END)]))
            expect(Result.INVALID_GOAL, "points[0].positions", goal([point(1, END[:5])]))
            expect(Result.INVALID_GOAL, "finite", goal([point(1, END[:5] + [float("inf")])]))
            expect(Result.INVALID_GOAL, "goes from", goal([point(1, [0, 0, 100.0, 0, 0, 0])]))
            expect(Result.INVALID_GOAL, "elsewhere at once", goal([point(0, END)]))
            late = goal([point(1, END)])
            late.trajectory.header.stamp = rospy.Time.now() - rospy.Duration(10)
            expect(Result.OLD_HEADER_TIMESTAMP, "not later", late)

    def test_tolerances(self):
        motors = "positions: {shoulder_lift: -1.2, elbow: 1.5}\nmotors:\n" + "".join(
            "  %s: {position: %g, %s}\n" % (joint, start, "max_force: 1" if joint == "shoulder_lift" else "max_force: 0")
            for joint, start in zip(JOINTS, START))
        with self.arm(motors, real_time_factor=0, paused=True) as client:  # a lift that cannot hold the arm
            client.send_goal(goal([point(2, START, [0.0] * 6)],
                                  path_tolerance=[JointTolerance(name="shoulder_lift", position=0.1)]))
            wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, "the goal")
            self.step_until_done(client)
            self.expect(client, GoalStatus.ABORTED, Result.PATH_TOLERANCE_VIOLATED,
                        "joint 'shoulder_lift': position off by 0.1", "tolerance 0.1")
        soft = motors.replace("max_force: 1", "servo_frequency: 1, servo_damping_ratio: 1, max_force: 0")
        still = [point(0.5, START, [0.0] * 6)]
        with self.arm(soft, real_time_factor=0, paused=True) as client:
            for fields, status, code in (
                    ({}, GoalStatus.ABORTED, Result.GOAL_TOLERANCE_VIOLATED),
                    ({"goal_tolerance": [JointTolerance(name="shoulder_lift", position=0.001)],
                      "goal_time_tolerance": rospy.Duration(0.2)}, GoalStatus.ABORTED, Result.GOAL_TOLERANCE_VIOLATED),
                    ({"goal_tolerance": [JointTolerance(name="shoulder_lift", position=-1, velocity=-1)]},
                     GoalStatus.SUCCEEDED, Result.SUCCESSFUL)):
                client.send_goal(goal(still, **fields))
                wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, "the goal")
                self.step_until_done(client)
                self.expect(client, status, code, "shoulder_lift" if code else "")

    def test_ends_before_the_trajectory(self):
        far = goal([point(10, END, [0.0] * 6)])
        with self.arm(paused=True, command="elbow") as client:
            def begin(other=None):
                (other or client).send_goal(far)
                wait_until(lambda: (other or client).get_state() == GoalStatus.ACTIVE, "the goal")
                self.good("step", steps=50)
            begin()
            client.cancel_goal()
            self.expect(client, GoalStatus.PREEMPTED, 0, "cancelled")
            self.good("step", steps=2)
            stopped = self.positions()
            self.assertNotAlmostEqual(stopped["elbow"], START[2], delta=1e-3)
            self.good("step", steps=100)
            for joint in JOINTS:
                self.assertAlmostEqual(self.positions()[joint], stopped[joint], delta=1e-9)
            begin()
            other = self.client("arm")
            begin(other)
            self.expect(client, GoalStatus.PREEMPTED, 0, "another goal takes joint")
            command = rospy.Publisher(NODE + "/command/elbow", Float64, queue_size=1)
            wait_until(command.get_num_connections, "command")
            command.publish(1.0)
            self.expect(other, GoalStatus.PREEMPTED, 0, "a command takes joint 'elbow'")
            begin()
            topic = rospy.Publisher(NODE + "/joint_trajectory", JointTrajectory, queue_size=1)
            wait_until(topic.get_num_connections, "joint_trajectory")
            topic.publish(JointTrajectory(joint_names=["wrist_1"], points=[point(1, [0.1])]))
            self.expect(client, GoalStatus.PREEMPTED, 0, "joint_trajectory takes joint 'wrist_1'")
            begin()
            everything = rospy.Publisher(action_name("arm") + "/cancel", GoalID, queue_size=1)
            wait_until(everything.get_num_connections, "cancel")
            everything.publish(GoalID())
            self.expect(client, GoalStatus.PREEMPTED, 0, "cancelled")
            begin()
            support.call("reset_world")
            self.expect(client, GoalStatus.PREEMPTED, 0, "ended by reset_world")
            begin()
            self.good("remove_constraint", name="elbow")
            self.expect(client, GoalStatus.ABORTED, Result.INVALID_JOINTS, "joint 'elbow' is gone")

    def test_goals_without_a_joint_in_common_go_on_together(self):
        with self.arm(paused=True) as client:
            other = self.client("arm")
            client.send_goal(goal([point(1, [0.5], [0.0])], ["shoulder_pan"]))
            other.send_goal(goal([point(0.5, [0.2], [0.0])], ["wrist_3"]))
            for each in (client, other):
                wait_until(lambda: each.get_state() == GoalStatus.ACTIVE, "a goal")
            self.good("step", steps=60)
            self.expect(other, GoalStatus.SUCCEEDED, 0)
            self.assertEqual(client.get_state(), GoalStatus.ACTIVE)
            self.good("step", steps=60)
            self.expect(client, GoalStatus.SUCCEEDED, 0)

    def test_feedback(self):
        seen = []
        with self.arm(paused=True) as client:
            client.send_goal(goal([point(1, END, [0.0] * 6)]), feedback_cb=seen.append)
            wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, "the goal")

            def is_shown():
                self.good("step", steps=1)
                return seen
            wait_until(is_shown, "feedback")
            shown = seen[-1]
            self.assertEqual(shown.joint_names, JOINTS)
            for k in range(6):
                self.assertAlmostEqual(shown.actual.positions[k] + shown.error.positions[k],
                                       shown.desired.positions[k], delta=1e-12)
                self.assertAlmostEqual(shown.error.positions[k], 0.0, delta=1e-9)
            # a cubic from rest to rest
            u = shown.desired.time_from_start.to_sec()
            share = 3 * u ** 2 - 2 * u ** 3
            self.assertAlmostEqual(shown.desired.positions[0], share * END[0], delta=1e-8)  # times in ns

    def test_each_robot_has_its_server_while_it_exists(self):
        with running(node_command(paused=True)):
            for i, prefix in enumerate(("left/", "right/")):
                self.good("load_urdf", path="arm", fixed=True, prefix=prefix, pose=at(2.0 * i))
            left, right = self.client("left"), self.client("right")
            for prefix, client in (("left/", left), ("right/", right)):
                client.send_goal(goal([point(0.2, END, [0.0] * 6)], [prefix + joint for joint in JOINTS]))
                wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, prefix)
            right.send_goal(goal([point(0.2, END)]))
            self.expect(right, GoalStatus.REJECTED, Result.INVALID_JOINTS, "robot 'right' has no joint 'shoulder_pan'")
            self.good("step", steps=30)
            self.expect(left, GoalStatus.SUCCEEDED, 0)
            left.send_goal(goal([point(1, START)], ["left/" + joint for joint in JOINTS]))
            wait_until(lambda: left.get_state() == GoalStatus.ACTIVE, "left/")
            for body in properties().bodies:
                if body.startswith("left/"):
                    self.good("remove_body", name=body)
            self.expect(left, GoalStatus.ABORTED, Result.INVALID_JOINTS, "is gone")
            wait_until(lambda: not [topic for topic, _ in rospy.get_published_topics(NODE + "/robots")
                                    if topic == action_name("left") + "/status"], "no server of left")
            self.good("load_urdf", path="arm", fixed=True, prefix="left/")
            again = self.client("left")
            again.send_goal(goal([], ["left/elbow"]))
            wait_until(lambda: again.get_state() == GoalStatus.ACTIVE, "left/")
            self.good("step", steps=2)
            self.expect(again, GoalStatus.SUCCEEDED, 0)


def at(x):
    pose = support.sphere("x").pose
    pose.position.x = x
    return pose


if __name__ == "__main__":
    rospy.init_node("test_actions")
    rostest.rosrun("constraint_sim", "actions", Actions)
