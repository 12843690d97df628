"""The services of one simulator as methods, and what belongs together as `with` blocks."""
import collections
import contextlib
import os
import re
import threading
import time

import rospy
import std_srvs.srv
from constraint_sim import srv
from geometry_msgs.msg import Point, Vector3, Wrench
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from constraint_sim_client import messages


class Refused(RuntimeError):
    """A rejected request; the text names field and value."""


# Position [m or rad], velocity, and effort of the actuator [N or N m] of a joint.
Joint = collections.namedtuple('Joint', 'position velocity effort')


class _Adding:
    """Functions that a simulator and a batch share: adding, removing and setting."""

    def add_sphere(self, name, radius, mass=0.0, **settings):
        """Adds a ball. Settings: position, orientation (x, y, z, w), linear_velocity,
        angular_velocity, type ('dynamic', 'static', 'kinematic'), inertia, friction, restitution,
        no_collision, collision_groups and collision_mask (a bit for each group),
        gravity_compensation, color (red, green, blue, opacity)."""
        self.add_body(messages.body(name, messages.sphere(radius), mass=mass, **settings))

    def add_box(self, name, size, mass=0.0, **settings):
        """Adds a box with these edges; settings as of add_sphere()."""
        self.add_body(messages.body(name, messages.box(size), mass=mass, **settings))

    def add_cylinder(self, name, radius, length, mass=0.0, **settings):
        """Adds a cylinder along its z axis; settings as of add_sphere()."""
        shape = messages.cylinder(radius, length)
        self.add_body(messages.body(name, shape, mass=mass, **settings))

    def add_capsule(self, name, radius, length, mass=0.0, **settings):
        """Adds a capsule along its z axis, with this length of the straight part; settings as of add_sphere()."""
        shape = messages.capsule(radius, length)
        self.add_body(messages.body(name, shape, mass=mass, **settings))

    def add_hull(self, name, vertices, mass=0.0, **settings):
        """Adds a convex hull of points, each three numbers; settings as of add_sphere()."""
        self.add_body(messages.body(name, messages.hull(vertices), mass=mass, **settings))

    def add_mesh(self, name, resource, mass=0.0, scale=(0, 0, 0), **settings):
        """Adds a mesh by its file, package:// or file://, on the node's machine; settings as of add_sphere()."""
        self.add_body(messages.body(name, messages.mesh(resource, scale), mass=mass, **settings))

    def add_point(self, name, mass=0.0, **settings):
        """Adds a point mass, which touches nothing."""
        self.add_body(messages.body(name, messages.point(), mass=mass, **settings))

    def add_plane(self, name, type='static', **settings):
        """Adds a half-space, solid below the x-y plane of its frame."""
        self.add_body(messages.body(name, messages.plane(), type=type, **settings))

    def add_constraint(self, name, type, **settings):
        """Adds a constraint of any type of scene files: body_a, anchor_a, axis_a, body_b, anchor_b, axis_b,
        and every setting of the type, as motor=dict(bias=0.5) or coordinates=[dict(lower=0, upper=1)]; a
        body left out is the world."""
        return self.add_constraint_message(messages.constraint(name, type, **settings))


class Batch(_Adding):
    """Edits that take effect together, in one tick, or not at all."""

    def __init__(self):
        self.request = srv.ApplyEditsRequest()
        self.answer = None  # response of the simulator, after the block

    def add_body(self, body):
        self.request.bodies.append(body)

    def add_constraint_message(self, constraint):
        self.request.constraints.append(constraint)

    def remove_body(self, name):
        self.request.remove_bodies.append(name)

    def remove_constraint(self, name):
        self.request.remove_constraints.append(name)

    def set_state(self, name, **state):
        self.request.states.append(messages.state(name, **state))

    def set_motor(self, constraint, bias, max_force=0.0, timeout=0.0):
        self.request.motors.append(messages.motor(constraint, bias, max_force, timeout))


def _text_in_parameter(name):
    """Returns the text in a parameter; empty where there is none, and for names that no parameter can
    have, such as a path with a dot."""
    if not re.fullmatch(r'[~/]?[A-Za-z][A-Za-z0-9_/]*', name):
        return ''
    text = rospy.get_param(name, '')
    return text if isinstance(text, str) else ''


class Simulator(_Adding):
    """A running node. Methods return what the service answers and raise Refused for what it
    refuses, rospy.ROSException where no such node is there within `timeout` seconds."""

    def __init__(self, node='/constraint_sim', timeout=10.0):
        self.node = rospy.names.resolve_name(node)
        self.timeout = timeout
        self._proxies = {}
        self._publishers = {}

    def call(self, service, /, **fields):
        """Any service of the node by its name, with the fields of its request."""
        proxy = self._proxies.get(service)
        if proxy is None:
            type_name = ''.join(word.title() for word in service.split('_'))
            kind = getattr(srv, type_name, std_srvs.srv.Empty)
            name = rospy.names.ns_join(self.node, service)
            rospy.wait_for_service(name, timeout=self.timeout)
            proxy = self._proxies[service] = rospy.ServiceProxy(name, kind)
        answer = proxy(**fields)
        if getattr(answer, 'success', True):
            return answer
        raise Refused('%s: %s' % (service, answer.status_message))

    # ---- bodies and constraints

    def add_body(self, body):
        return self.call('add_body', body=body)

    def add_constraint_message(self, constraint):
        return self.call('add_constraint', constraint=constraint)

    def remove_body(self, name):
        return self.call('remove_body', name=name)

    def remove_constraint(self, name):
        return self.call('remove_constraint', name=name)

    def state(self, name, frame=''):
        """Pose and twist of a body as BodyState."""
        return self.call('get_body_state', name=name, reference_frame=frame).state

    def set_state(self, name, frame='', **state):
        return self.call('set_body_state', state=messages.state(name, **state),
                         reference_frame=frame)

    def set_body(self, name, **settings):
        """Mass, inertia_x and so on, friction, restitution, no_collision, collision_groups,
        collision_mask, gravity_compensation."""
        return self._set('set_body_properties', name, settings)

    def set_constraint(self, name, **settings):
        """Whatever of scene files can change while the constraint acts."""
        return self._set('set_constraint_properties', name, settings)

    def _set(self, service, name, settings):
        return self.call(service, name=name, keys=list(settings),
                         values=[float(value) for value in settings.values()])

    def load_urdf(self, robot='', text='', prefix='', position=(0, 0, 0), orientation=(0, 0, 0, 1),
                  fixed=False, extra=''):
        """Adds a robot by its URDF: `text`, or `robot`, which is the name of a parameter with the text, a
        path, package:// or the name of a shipped robot. The simulator reads files. `extra` is the
        YAML beside the URDF."""
        path = ''
        if robot:
            text = _text_in_parameter(robot)
            if not text:
                file = os.path.abspath(os.path.expanduser(robot))
                path = file if os.path.isfile(file) else robot
        return self.call('load_urdf', path=path, text=text, prefix=prefix,
                         pose=messages.state('', position, orientation).pose, fixed=fixed, extra=extra)

    def set_motor(self, constraint, bias, max_force=0.0, timeout=0.0):
        return self.call('set_motor_bias', constraint=constraint, bias=bias, max_force=max_force,
                         timeout=timeout)

    def set_position(self, constraint, position):
        """Sends a motor to a position [m or rad]: its target, as of `motor: {position: ...}`."""
        return self.set_constraint(constraint, motor_position=position)

    def set_force(self, constraint, force):
        """Lets a motor act with a constant force [N or N m]."""
        return self.set_constraint(constraint, motor_force=force)

    def joints(self, robot=''):
        """Position, velocity and effort by joint: of one robot, by its prefix or name, or of all joints."""
        topic = 'robots/%s/joint_states' % robot.rstrip('/') if robot else 'joint_states'
        states = self._next(topic, JointState)
        return {name: Joint(*values) for name, *values in
                zip(states.name, states.position, states.velocity, states.effort)}

    def follow(self, joints, *points):
        """Sends a trajectory of joints to the topic joint_trajectory. Each point is (time [s], positions), and may
        have velocities and accelerations behind. A wrong one is a line in the log of the simulator. It takes effect
        soon after the call, also while the world is paused."""
        trajectory = JointTrajectory(joint_names=list(joints))
        for time_from_start, *values in points:
            trajectory.points.append(JointTrajectoryPoint(
                time_from_start=rospy.Duration.from_sec(time_from_start),
                **dict(zip(('positions', 'velocities', 'accelerations'), map(list, values)))))
        self._publisher('joint_trajectory', JointTrajectory).publish(trajectory)

    def _publisher(self, topic, kind):
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = rospy.Publisher(
                rospy.names.ns_join(self.node, topic), kind, queue_size=10)
        end = time.monotonic() + self.timeout
        while publisher.get_num_connections() == 0:
            if time.monotonic() > end:
                raise rospy.ROSException('nobody listens to %s' % publisher.name)
            time.sleep(0.01)
        return publisher

    def _next(self, topic, kind):
        """The first message that the simulator publishes from now on; rospy.wait_for_message counts simulated time."""
        done = threading.Event()
        messages_ = []

        def receive(message):
            messages_.append(message)
            done.set()
        subscriber = rospy.Subscriber(rospy.names.ns_join(self.node, topic), kind, receive)
        try:
            if not done.wait(self.timeout):
                raise rospy.ROSException('no message on %s' % subscriber.name)
        finally:
            subscriber.unregister()
        return messages_[0]

    def push(self, body, force=(0, 0, 0), torque=(0, 0, 0), duration=-1.0, point=(0, 0, 0),
             frame=''):
        """A wrench for so many simulated seconds; below 0: for ever."""
        return self.call('apply_body_wrench', body_name=body, reference_frame=frame,
                         reference_point=Point(*point),
                         wrench=Wrench(Vector3(*force), Vector3(*torque)),
                         duration=rospy.Duration.from_sec(duration))

    @contextlib.contextmanager
    def batch(self):
        """A Batch that takes effect when the block ends; nothing does where that raises."""
        batch = Batch()
        yield batch
        fields = {name: getattr(batch.request, name) for name in batch.request.__slots__}
        batch.answer = self.call('apply_edits', **fields)

    # ---- the world

    def properties(self):
        return self.call('get_world_properties')

    def set_options(self, **options):
        """Options of the world of scene files; also real_time_factor and publish_rate."""
        return self.call('set_options', keys=list(options),
                         values=[messages.option(value) for value in options.values()])

    def load(self, scene='', text='', path=''):
        """Loads a scene by the name of a shipped one, by a path (`scene` and `path` are one), or by its text."""
        return self.call('load_scene', path=scene or path, text=text)

    def save(self, path=''):
        """The world as a scene."""
        return self.call('save_scene', path=path).text

    def pause(self):
        self.call('pause_physics')

    def unpause(self):
        self.call('unpause_physics')

    def step(self, steps=1, rates=None, positions=None, forces=None):
        """Only while paused; bodies and hash after the last step. Motors are set before, by their constraints'
        names: `rates` of all at once or none, then `positions` and `forces`."""
        if rates:
            with self.batch() as batch:
                for constraint, rate in rates.items():
                    batch.set_motor(constraint, rate)
        for constraint, position in (positions or {}).items():
            self.set_position(constraint, position)
        for constraint, force in (forces or {}).items():
            self.set_force(constraint, force)
        return self.call('step', steps=steps)

    def reset(self):
        self.call('reset_world')

    def verify(self, steps):
        """The answer of the service `verify` for the next ticks, on copies; 0 cancels."""
        return self.call('verify', steps=steps)

    @contextlib.contextmanager
    def paused(self):
        """The simulator, paused until the block ends if it was running."""
        was_running = not self.properties().paused
        self.pause()
        try:
            yield self
        finally:
            if was_running:
                self.unpause()

    def save_snapshot(self, name='', path=''):
        """The world to the bit; without a name under one of the ring, which is answered."""
        return self.call('save_snapshot', name=name, path=path)

    def restore_snapshot(self, name='', path=''):
        return self.call('restore_snapshot', name=name, path=path)

    @contextlib.contextmanager
    def tried(self):
        """Whatever the block does, the world is then as it was before."""
        snapshot = self.save_snapshot()
        try:
            yield self
        finally:
            self.restore_snapshot(snapshot.name)
