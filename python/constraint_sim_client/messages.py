"""Messages from keywords: vectors and quaternions as sequences of numbers."""
from constraint_sim.msg import (Body, BodyState, Constraint, CoordinateLaw, Motor, MotorBias, Parameter,
                                Shape)
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from std_msgs.msg import ColorRGBA

BODY_TYPES = {'dynamic': Body.DYNAMIC, 'static': Body.STATIC, 'kinematic': Body.KINEMATIC}
VECTORS = {'anchor_a': Point, 'anchor_b': Point, 'axis_a': Vector3, 'axis_b': Vector3}


def state(name, position=(0, 0, 0), orientation=(0, 0, 0, 1), linear_velocity=(0, 0, 0),
          angular_velocity=(0, 0, 0)):
    """A BodyState; the orientation is a quaternion x, y, z, w."""
    return BodyState(name=name, pose=Pose(Point(*position), Quaternion(*orientation)),
                     twist=Twist(Vector3(*linear_velocity), Vector3(*angular_velocity)))


def body(name, shape, type='dynamic', mass=0.0, inertia=(0, 0, 0), friction=0.0, restitution=0.0,
         no_collision=False, collision_groups=0, collision_mask=0, gravity_compensation=0.0,
         color=(0, 0, 0, 0), **of_state):
    """A Body with a Shape, at the pose and twist of state(); `color` is red, green, blue and opacity."""
    if type not in BODY_TYPES:
        raise ValueError('type must be one of %s, got %r' % (', '.join(BODY_TYPES), type))
    placed = state(name, **of_state)
    return Body(name=name, type=BODY_TYPES[type], shapes=[shape], mass=mass,
                inertia=Vector3(*inertia), pose=placed.pose, twist=placed.twist,
                friction=friction, restitution=restitution, no_collision=no_collision,
                collision_groups=collision_groups, collision_mask=collision_mask,
                gravity_compensation=gravity_compensation, color=ColorRGBA(*color))


def sphere(radius):
    return Shape(type=Shape.SPHERE, dimensions=[radius])


def box(size):
    return Shape(type=Shape.BOX, dimensions=list(size))


def point():
    return Shape(type=Shape.POINT)


def cylinder(radius, length):
    return Shape(type=Shape.CYLINDER, dimensions=[radius, length])


def capsule(radius, length):
    """A capsule; length is that of the straight part, between the centres of the round ends."""
    return Shape(type=Shape.CAPSULE, dimensions=[radius, length])


def hull(vertices):
    """A convex hull of points, each three numbers."""
    return Shape(type=Shape.HULL, vertices=[Point(*vertex) for vertex in vertices])


def mesh(resource, scale=(0, 0, 0)):
    """A mesh by its file, package:// or file://, which is divided into convex parts."""
    return Shape(type=Shape.MESH, mesh_resource=resource, mesh_scale=Vector3(*scale))


def plane():
    return Shape(type=Shape.PLANE)


def set_fields(message, settings):
    """Sets fields of a message by name; a name that is no field raises TypeError."""
    for key, value in settings.items():
        if key not in message.__slots__:
            raise TypeError('a %s has no setting %r' % (type(message).__name__, key))
        setattr(message, key, value)
    return message


def coordinate_motor(**settings):
    """A Motor with the keys of `motor` in scene files: by rate, or to a `position`, or with a `force`."""
    mode = (Motor.POSITION if 'position' in settings else
            Motor.FORCE if 'force' in settings else Motor.RATE)
    return set_fields(Motor(mode=mode), settings)


def coordinate_law(motor=None, **settings):
    """A CoordinateLaw with the keys of a coordinate in scene files; `motor` is a dict."""
    if 'lower' in settings or 'upper' in settings:
        settings = {'has_limits': True, 'lower': -float('inf'), 'upper': float('inf'), **settings}
    if 'position' in settings:
        settings = {'has_position': True, **settings}
    law = set_fields(CoordinateLaw(), settings)
    if motor is not None:
        law.motor = coordinate_motor(**motor)
    return law


def constraint(name, type, coordinates=(), joints=None, parameters=None, **settings):
    """A Constraint with the keys of scene files. Keys of laws, such as `lower` and `motor`, are those of
    the first coordinate; `coordinates` is a list of dicts instead. `joints` are the two constraints that a
    gear or pulley couples, and `parameters` a dict of a plugin's."""
    message = Constraint(name=name, type=type)
    law = {key: settings.pop(key) for key in list(settings) if key in CoordinateLaw.__slots__}
    if law and coordinates:
        raise TypeError('coordinates already has the first: %s' % ', '.join(law))
    message.coordinates = [coordinate_law(**each) for each in coordinates or ([law] if law else [])]
    if joints is not None:
        message.body_a, message.body_b = joints
    message.parameters = [Parameter(name=key, value=value) for key, value in (parameters or {}).items()]
    for key in ('ratio', 'pitch', 'value'):
        if key in settings:
            setattr(message.coupling, key, settings.pop(key))
            message.coupling.has_value = message.coupling.has_value or key == 'value'
    return set_fields(message, {key: VECTORS[key](*value) if key in VECTORS else value
                                for key, value in settings.items()})


def motor(constraint_name, bias, max_force=0.0, timeout=0.0):
    return MotorBias(constraint=constraint_name, bias=bias, max_force=max_force, timeout=timeout)


def option(value):
    """A value of an option as scene files have it."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, (tuple, list)):
        return '[%s]' % ', '.join(option(one) for one in value)
    return repr(value).replace('inf', '.inf') if isinstance(value, float) else str(value)
