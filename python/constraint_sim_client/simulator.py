"""The services of one simulator as methods, and what belongs together as `with` blocks."""
import contextlib
import os
import re

import rospy
import std_srvs.srv
from constraint_sim import srv
from geometry_msgs.msg import Point, Vector3, Wrench

from constraint_sim_client import messages


class Refused(RuntimeError):
    """The simulator's answer to what cannot be; its text names field and value."""


class _Adding:
    """What a simulator and a batch have in common: adding, removing and setting."""

    def add_sphere(self, name, radius, mass=0.0, **settings):
        """Adds a ball. Settings: position, orientation (x, y, z, w), linear_velocity,
        angular_velocity, type ('dynamic', 'static', 'kinematic'), inertia, friction, restitution,
        no_collision, color (red, green, blue, opacity)."""
        self.add_body(messages.body(name, messages.sphere(radius), mass=mass, **settings))

    def add_box(self, name, size, mass=0.0, **settings):
        """Adds a box with these edges; settings as of add_sphere()."""
        self.add_body(messages.body(name, messages.box(size), mass=mass, **settings))

    def add_cylinder(self, name, radius, length, mass=0.0, **settings):
        """Adds a cylinder along its z axis; settings as of add_sphere()."""
        shape = messages.cylinder(radius, length)
        self.add_body(messages.body(name, shape, mass=mass, **settings))

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
        self.answer = None  # of the simulator, after the block

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
        """Mass, inertia_x and so on, friction, restitution, no_collision."""
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

    def load(self, scene='', text=''):
        return self.call('load_scene', path=scene, text=text)

    def save(self, path=''):
        """The world as a scene."""
        return self.call('save_scene', path=path).text

    def pause(self):
        self.call('pause_physics')

    def unpause(self):
        self.call('unpause_physics')

    def step(self, steps=1):
        """Only while paused; bodies and hash after the last one."""
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
