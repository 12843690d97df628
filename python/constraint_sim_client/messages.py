"""Messages from keywords: vectors and quaternions as sequences of numbers."""
from constraint_sim.msg import Body, BodyState, Constraint, MotorBias, Shape
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3

BODY_TYPES = {'dynamic': Body.DYNAMIC, 'static': Body.STATIC, 'kinematic': Body.KINEMATIC}
VECTORS = {'anchor_a': Point, 'anchor_b': Point, 'axis_a': Vector3, 'axis_b': Vector3}


def state(name, position=(0, 0, 0), orientation=(0, 0, 0, 1), linear_velocity=(0, 0, 0),
          angular_velocity=(0, 0, 0)):
    """A BodyState; the orientation is a quaternion x, y, z, w."""
    return BodyState(name=name, pose=Pose(Point(*position), Quaternion(*orientation)),
                     twist=Twist(Vector3(*linear_velocity), Vector3(*angular_velocity)))


def body(name, shape, type='dynamic', mass=0.0, inertia=(0, 0, 0), friction=0.0, restitution=0.0,
         no_collision=False, **of_state):
    """A Body; `shape` is a Shape, and what state() takes says where it is."""
    if type not in BODY_TYPES:
        raise ValueError('type must be one of %s, got %r' % (', '.join(BODY_TYPES), type))
    placed = state(name, **of_state)
    return Body(name=name, type=BODY_TYPES[type], shape=shape, mass=mass,
                inertia=Vector3(*inertia), pose=placed.pose, twist=placed.twist,
                friction=friction, restitution=restitution, no_collision=no_collision)


def sphere(radius):
    return Shape(type=Shape.SPHERE, dimensions=[radius])


def box(size):
    return Shape(type=Shape.BOX, dimensions=list(size))


def point():
    return Shape(type=Shape.POINT)


def cylinder(radius, length):
    return Shape(type=Shape.CYLINDER, dimensions=[radius, length])


def plane():
    return Shape(type=Shape.PLANE)


def constraint(name, type, **settings):
    """A Constraint. A setting that the message has no field for goes to its keys and values."""
    message = Constraint(name=name, type=type)
    for key, value in settings.items():
        if key in VECTORS:
            setattr(message, key, VECTORS[key](*value))
        elif key in ('keys', 'values', 'name', 'type'):
            raise TypeError('a constraint has no setting %r' % key)
        elif key in Constraint.__slots__:
            setattr(message, key, value)
        else:
            message.keys.append(key)
            message.values.append(float(value))
    return message


def motor(constraint_name, bias, max_force=0.0, timeout=0.0):
    return MotorBias(constraint=constraint_name, bias=bias, max_force=max_force, timeout=timeout)


def option(value):
    """A value of an option as scene files have it."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, (tuple, list)):
        return '[%s]' % ', '.join(option(one) for one in value)
    return repr(value).replace('inf', '.inf') if isinstance(value, float) else str(value)
