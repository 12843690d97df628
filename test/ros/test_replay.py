#!/usr/bin/env python3
"""A recorded run is repeated with equal hashes; a difference is reported by name."""
import copy
import os
import random
import subprocess
import tempfile

import rosbag
import rospy
import rostest
from constraint_sim.msg import Constraint, EditRecord, MotorBias, Shape
from geometry_msgs.msg import Vector3, Wrench
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import support
from support import NODE, call, properties, sphere


def replay(*arguments):
    """Returns exit status and output."""
    done = subprocess.run(["rosrun", "constraint_sim", "replay", *arguments],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, timeout=500)
    return done.returncode, done.stdout


class Replay(support.ServiceCase):
    def setUp(self):
        support.empty_world()
        self.folder = tempfile.TemporaryDirectory()
        self.file = os.path.join(self.folder.name, "run.bag")
        self.log = support.Listener(NODE + "/edit_log", EditRecord)

    def tearDown(self):
        support.Listener.stop_all()
        self.folder.cleanup()

    def begin(self):
        support.wait_until(lambda: self.log.messages, "the world that the log begins with")
        self.assertEqual(self.log.messages[0].service, "snapshot")

    def write(self, records, topic="/constraint_sim/edit_log"):
        with rosbag.Bag(self.file, "w") as bag:
            for i, record in enumerate(records):
                bag.write(topic, record, rospy.Time(1 + i))

    def end(self):
        """Writes all messages so far to the bag; returns the final hash."""
        self.assertTrue(call("add_body", body=sphere("last", z=77.0)).success)
        # pending commands may still arrive
        support.wait_until(lambda: any(r.service == "add_body" and b"last" in bytes(r.request)
                                       for r in self.log.messages) and
                           self.log.messages[-1].state_hash == properties().state_hash,
                           "the last record")
        self.write(self.log.messages)

    def some_edit(self, number, draw):
        kind = draw.randrange(9)
        name = "ball_%d" % number
        ball = sphere(name, x=3.0 * number, z=draw.uniform(1, 3), no_collision=True)
        if kind < 3:
            self.good("add_body", body=ball)
            self.good("add_distance_constraint", name="rod_%d" % number, body_b=name)
            self.good("set_motor_bias", constraint="rod_%d" % number, bias=0.1, timeout=0.5)
        elif kind == 3:
            self.good("apply_edits", bodies=[ball], constraints=[
                Constraint(name="rope_%d" % number, type="rope", body_b=name, max_length=99.0)])
        elif kind == 4:
            self.good("apply_body_wrench", body_name="first", duration=rospy.Duration(0.25),
                      wrench=Wrench(force=Vector3(draw.uniform(-1, 1), 0, 2)))
        elif kind == 5:
            self.good("set_options", keys=["gravity"],
                      values=["[0, 0, %r]" % draw.uniform(-10, -5)])
        elif kind == 6:
            self.good("set_body_properties", name="first", keys=["mass"],
                      values=[draw.uniform(1, 2)])
        elif kind == 7:
            call("reset_world")
        else:
            self.good("save_snapshot", name="some")

    def test_a_run_with_all_kinds_of_edits(self):
        self.good("load_scene", path="double_pendulum")
        self.good("add_body", body=sphere("first", x=-3.0))
        self.good("step", steps=37)
        self.begin()
        draw = random.Random(1)
        for number in range(60):
            self.some_edit(number, draw)
            self.good("step", steps=draw.randrange(40))
        call("reset_simulation")
        self.good("step", steps=250)
        self.good("restore_snapshot", name="some")
        self.good("step", steps=50)
        self.good("load_scene", path="winch")
        self.good("step", steps=120)
        self.end()
        status, said = replay(self.file)
        self.assertEqual(status, 0, said)
        self.assertIn("%d records" % len(self.log.messages), said)
        self.assertGreater(sum(not r.service for r in self.log.messages), 5)  # checks in between
        self.assertGreater(len({r.service for r in self.log.messages}), 10)

    def test_a_mesh_whose_file_is_gone(self):
        """The log has the convex parts of the mesh, so that a replay does not read the file."""
        path = os.path.join(self.folder.name, "tetrahedron.obj")
        with open(path, "w") as file:
            file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
        self.good("load_scene", text="world: {}")
        self.begin()
        mesh = Shape(type=Shape.MESH, mesh_resource=path)
        answer = call("add_body", body=sphere("tetrahedron", z=1.0, shapes=[mesh]))
        self.assertIn("its convex hull with 4 vertices", answer.status_message)
        os.remove(path)
        self.good("step", steps=50)
        self.end()
        status, said = replay(self.file)
        self.assertEqual(status, 0, said)

    def test_a_run_in_real_time_with_a_stream_of_commands(self):
        self.good("load_scene", path="platform")
        self.begin()
        bias = rospy.Publisher(NODE + "/motor_bias", MotorBias, queue_size=10)
        support.wait_until(bias.get_num_connections, "the subscriber of motor_bias")
        motor = properties().constraints[0]
        call("unpause_physics")
        sent = []

        def streamed():  # a hundred a second
            sent.append(0.001 * len(sent))
            bias.publish(constraint=motor, bias=sent[-1], timeout=0.5)
            return sum(r.service == "set_motor_bias" for r in self.log.messages) > 50
        support.wait_until(streamed, "the commands in the log")
        call("pause_physics")
        self.end()
        status, said = replay(self.file)
        self.assertEqual(status, 0, said)

    def test_a_run_with_topics_that_drive(self):
        joints = ["shoulder_pan", "elbow"]
        self.good("load_urdf", path="arm", fixed=True,
                  extra="motors: {shoulder_pan: {bias: 0, max_force: 0}, elbow: {bias: 0, max_force: 0}}")
        self.begin()
        topic = rospy.Publisher(NODE + "/joint_trajectory", JointTrajectory, queue_size=1)
        support.wait_until(topic.get_num_connections, "the subscriber of joint_trajectory")
        points = [JointTrajectoryPoint(positions=[0.3, 0.2], time_from_start=rospy.Duration(0.5)),
                  JointTrajectoryPoint(positions=[-0.2, 0.4], time_from_start=rospy.Duration(1.0))]
        edits = len(self.log.messages)
        topic.publish(JointTrajectory(joint_names=joints, points=points))
        support.wait_until(lambda: len(self.log.messages) > edits, "the edit that begins it")
        self.good("step", steps=150)
        self.end()
        driven = [r for r in self.log.messages if r.service == "drive"]
        self.assertGreater(len({r.step for r in driven}), 90)
        # commands are recorded, and the world only once
        self.assertEqual([r.service for r in self.log.messages].count("snapshot"), 1)
        self.assertLess(max(len(r.request) for r in driven), 400)
        status, said = replay(self.file)
        self.assertEqual(status, 0, said)
        # a step with another result is found, although worlds are recorded in between
        records = self.log.messages
        changed = driven[80]
        changed.state_hash ^= 1
        self.write(records)
        status, said = replay(self.file)
        self.assertEqual(status, 1, said)
        self.assertIn("differs at step %d" % changed.step, said)

    def test_a_step_number_that_is_damaged_ends_it(self):
        self.good("load_scene", path="pendulum")
        self.begin()
        self.good("step", steps=250)
        self.end()
        last = self.log.messages[-1].step
        for step in (2 ** 64 - 1, last + 10 ** 12, last + 101):
            records = [copy.copy(r) for r in self.log.messages]
            records[-1].step = step
            self.write(records)
            status, said = replay(self.file)
            self.assertEqual(status, 2, said)
            self.assertIn("step %d" % step, said)

    def test_a_long_run_of_commands(self):
        """Runs commands for an hour with CONSTRAINT_SIM_TEST_ALL, else for a hundred seconds."""
        is_long = "CONSTRAINT_SIM_TEST_ALL" in os.environ
        seconds, wall, least = (3600.0, 30.0, 600) if is_long else (100.0, 10.0, 100)
        self.good("load_scene", path="platform")
        winches = properties().constraints
        self.good("add_body", body=sphere("first", x=9.0))
        self.begin()
        # at full speed it would run for days while a busy machine sends commands
        call("set_options", keys=["real_time_factor"], values=[str(seconds / wall)])
        end = properties().sim_time + seconds
        draw, commands = random.Random(2), 0
        call("unpause_physics")
        while properties().sim_time < end or commands < least:
            commands += 1
            self.good("set_motor_bias", constraint=draw.choice(winches),
                      bias=draw.uniform(-0.02, 0.02), timeout=draw.uniform(0, 3))
            self.good("apply_body_wrench", body_name="first", duration=rospy.Duration(0.25),
                      wrench=Wrench(force=Vector3(draw.uniform(-1, 1), 0, 9.81)))
        call("pause_physics")
        call("set_options", keys=["real_time_factor"], values=["1"])
        self.end()
        self.assertGreaterEqual(sum(r.service == "set_motor_bias" for r in self.log.messages), least)
        status, said = replay(self.file)
        self.assertEqual(status, 0, said)

    def test_the_first_record_that_differs_is_named(self):
        self.good("load_scene", path="pendulum")
        call("reset_simulation")
        self.begin()
        self.good("step", steps=150)
        self.good("add_body", body=sphere("ball", x=5.0))
        self.good("step", steps=20)
        self.end()
        records = self.log.messages
        added = next(r for r in records if r.service == "add_body")
        self.assertEqual(added.step, 150)
        added.state_hash ^= 1
        self.write(records)
        status, said = replay(self.file)
        self.assertEqual(status, 1)
        for word in ("step 150", "add_body", "step 100"):
            self.assertIn(word, said)

    def test_what_cannot_be_replayed(self):
        self.good("load_scene", path="pendulum")
        self.begin()
        self.good("step", steps=250)
        self.end()
        records = self.log.messages
        self.write(records[:1] + records[2:])
        self.assertEqual(replay(self.file)[0], 2)
        self.assertIn("missing", replay(self.file)[1])
        self.write(records[2:])
        self.assertIn("no snapshot", replay(self.file)[1])
        self.write([])
        self.assertIn("no edit log", replay(self.file)[1])
        records[-1].request = records[-1].request[:5]
        self.write(records)
        self.assertIn("cut off", replay(self.file)[1])
        self.assertEqual(replay(os.path.join(self.folder.name, "none.bag"))[0], 2)
        self.assertEqual(replay()[0], 2)

    def test_a_step_that_fails_is_replayed_as_well(self):
        self.begin()
        fast = sphere("fast", x=1e20)
        fast.twist.linear.x = 1e20
        self.good("add_body", body=fast)
        self.assertFalse(call("step", steps=5).success)
        self.good("remove_body", name="fast")
        self.good("add_body", body=sphere("ball"))
        self.good("step", steps=5)
        self.end()
        self.assertIn("failed_step", {r.service for r in self.log.messages})
        status, said = replay(self.file)
        self.assertEqual(status, 0, said)


if __name__ == "__main__":
    rospy.init_node("test_replay")
    rostest.rosrun("constraint_sim", "replay", Replay)
