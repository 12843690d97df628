"""The engine of constraint_sim: worlds of rigid bodies, stepped without ROS.

All quantities are in SI units, vectors in world axes, quaternions as x y z w. docs/python.md is
the manual."""
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple, TypedDict, Union

import numpy as np

__version__: str
METHODS: Tuple[str, ...]

Vector = Sequence[float]
Tuple3 = Tuple[float, float, float]
Tuple4 = Tuple[float, float, float, float]


class SceneError(ValueError):
    """A scene that cannot be: `source:line: path.of.key: what is wrong, with the value`."""


class Point:
    """Point()

    Touches nothing, and rotates only with an inertia."""
    def __init__(self) -> None: ...


class Sphere:
    """Sphere(radius)

    Centred on the body; radius [m] > 0."""
    def __init__(self, radius: float) -> None: ...
    @property
    def radius(self) -> float:
        """[m]"""


class Box:
    """Box(size)

    Centred on the body, whole edge lengths along its axes [m] > 0."""
    def __init__(self, size: Vector) -> None: ...
    @property
    def size(self) -> Tuple3:
        """[m]"""


class Plane:
    """Plane()

    Solid below the body's x-y plane; static and kinematic bodies only."""
    def __init__(self) -> None: ...


class Cylinder:
    """Cylinder(radius, length)

    Centred on the body, along its z axis, with flat ends; radius and length [m] > 0."""
    def __init__(self, radius: float, length: float) -> None: ...
    @property
    def radius(self) -> float:
        """[m]"""
    @property
    def length(self) -> float:
        """[m]"""


class Hull:
    """Hull(vertices)

    Convex hull of points [m], a list of (x, y, z), by Qhull; at most 100000 points and 512 vertices."""
    def __init__(self, vertices: Iterable[Vector]) -> None: ...
    @property
    def vertices(self) -> List[Tuple3]:
        """[m]"""
    @property
    def faces(self) -> List[List[int]]:
        """numbers of the vertices of each face, counter-clockwise from outside"""
    @property
    def volume(self) -> float:
        """[m^3]"""
    @property
    def centre(self) -> Tuple3:
        """centre of the volume [m]"""


class Capsule:
    """Capsule(radius, length)

    Centred on the body, along its z axis: a cylinder with half spheres as ends; radius and length of the cylinder [m] > 0."""
    def __init__(self, radius: float, length: float) -> None: ...
    @property
    def radius(self) -> float:
        """[m]"""
    @property
    def length(self) -> float:
        """between the centres of the half spheres [m]"""


class Compound:
    """Compound(shapes)

    Several spheres, boxes, cylinders, capsules and hulls of one body, a list of shapes, of pairs (shape, shape_pose), or of triples (shape, shape_pose, surface), the surface a dict with friction and restitution where these are not the body's; at most 4096."""
    def __init__(self, shapes: Iterable[Union["Shape", Tuple["Shape", Optional[Mapping[str, Vector]]], Tuple["Shape", Optional[Mapping[str, Vector]], Mapping[str, Optional[float]]]]]) -> None: ...
    @property
    def shapes(self) -> List[Tuple["Shape", Dict[str, Any], Dict[str, float]]]:
        """triples of each shape, its pose, a dict of position [m] and orientation (x, y, z, w), and its surface, a dict with the friction and restitution that are not the body's"""


Shape = Union[Point, Sphere, Box, Plane, Cylinder, Hull, Capsule, Compound]


class State(TypedDict):
    position: Tuple3          # centre of mass, world [m]
    orientation: Tuple4       # body to world, x y z w
    linear_velocity: Tuple3   # world [m/s]
    angular_velocity: Tuple3  # world [rad/s]


class CoordinateState(TypedDict):
    position: float  # whole turns counted [m or rad]
    velocity: float  # [m/s or rad/s]
    effort: float    # force or torque of its laws and couplings, mean over the step [N or N m]
    bias: float      # velocity requested of its motor [m/s or rad/s]


class JointWrench(TypedDict):
    force: Tuple3   # on body B, in the joint's frame on B [N]
    torque: Tuple3  # about anchor B [N m]


class JointState(TypedDict):
    error: Optional[float]       # [m]; None where the function of a custom joint fails
    error_rate: Optional[float]  # [m/s]; None as error
    angle_error: float   # angle between axes that the joint keeps aligned [rad]
    force: float         # along the joint, mean over the step [N]; < 0 is tension
    bias: float          # velocity requested of the motor [m/s]
    reached_rate: float  # actual velocity [m/s]
    travel: float        # length that the motor has added [m]
    saturated: bool
    broken: bool
    closing: bool
    coordinates: List[CoordinateState]  # free coordinates, in the order of docs/joints.md


class Island(TypedDict):
    first_body: str
    bodies: int
    joints: int
    method: str
    why: str
    local_error: Optional[float]  # error estimate [m]; None where there is none
    substeps: int
    rejected: int
    evaluations: int  # evaluations of the equations of motion in explicit substeps
    events: int
    iterations: int
    unresolved_bodies: int
    dependent_rows: int


class Contact(TypedDict):
    body_a: str
    body_b: str
    position: Tuple3     # on B's surface, world [m]
    normal: Tuple3       # unit, from B to A, world
    depth: float         # [m]
    normal_force: float  # mean over the step [N]
    force: Tuple3        # normal and friction, on A, world [N]
    state: str           # closed, sticking or slipping
    part_a: int          # number of the shape in its body, 0 unless that has several
    part_b: int


class RayHit(TypedDict):
    body: str
    distance: float      # from the origin [m]; 0 where the ray starts inside the body
    point: Tuple3        # on the surface, world [m]; inside: the origin
    normal: Tuple3       # unit, outward, world; inside: against the ray
    inside: bool         # the ray starts inside the body


class ClosestPoints(TypedDict):
    distance: float      # gap [m]; negative: least translation that separates the bodies
    point_a: Tuple3      # on A's surface, world [m]
    point_b: Tuple3      # on B's surface, world [m]
    normal: Tuple3       # unit, from B to A, world


class Event(TypedDict):
    kind: str                  # broken, rope_taut, ..., contact_began, contact_ended, hit, handed_over, taken_back
    time: float                # simulated [s]
    body_a: str                # first body of the contact, joint or island; 'world' for the world
    body_b: str                # second body; equal to body_a for an island of one body
    joint: Optional[str]       # joint of the event; None for contacts and islands
    coordinate: Optional[int]  # coordinate of the joint; None for lengths, breaking, contacts and islands
    impulse: float             # impulse of the impact at the event [N s or N m s]


class StepWarning(TypedDict):
    kind: str                  # unclosed, energy_rise, hits_left, overlap, creep, unsolved, unresolved, handed_over
    name: str                  # joint of unclosed, else first or worst body
    value: float               # figure of the warning
    unit: str                  # unit of the value; '' for numbers of hits, bodies or islands
    advice: str                # remedy
    is_notice: bool            # the result is still trustworthy
    text: str                  # one line with the advice


class RobotCoordinate(TypedDict):
    name: str                  # unique in the robot
    joint: Optional[str]       # None: a free base
    coordinate: Optional[int]  # number in the joint; None: a motion without laws
    is_angle: bool
    position: Optional[float]  # [m or rad]; None for turns by three angles
    velocity: float            # [m/s or rad/s]


class RobotFollower(TypedDict):
    joint: str
    coordinate: int            # number in the joint
    leader: int                # index in RobotDynamics.coordinates
    ratio: float               # rate over the rate of the leader


class PointMotion(TypedDict):
    jacobian: np.ndarray       # (6, n), linear rows before angular ones, world axes
    velocity: np.ndarray       # (6,) [m/s, rad/s]
    bias: np.ndarray           # (6,) [m/s^2, rad/s^2]


class Linearization(TypedDict):
    A: np.ndarray              # (2n, 2n)
    B: np.ndarray              # (2n, n)
    acceleration: np.ndarray   # (n,) [m/s^2 or rad/s^2]


class StepReport:
    """Counts, errors and costs of one step. A copy: it keeps its values when the world steps
    on."""
    @property
    def step(self) -> int:
        """steps since the start, this one included"""
    @property
    def time(self) -> float:
        """simulated time after the step [s]"""
    @property
    def max_constraint_error(self) -> float:
        """largest |error| of the joints, springs and closing_error excepted [m]"""
    @property
    def worst_joint(self) -> Optional[str]:
        """joint whose error it is, or None"""
    @property
    def closing_error(self) -> float:
        """largest |error| of joints that an edit, or a motor sent to a position, is closing [m]"""
    @property
    def closing_joint(self) -> Optional[str]:
        """joint whose error it is, or None"""
    @property
    def unclosed_joints(self) -> int:
        """joints off by more than 1e-3 m that are not being closed"""
    @property
    def max_penetration(self) -> float:
        """deepest contact [m]"""
    @property
    def overlap(self) -> float:
        """deepest contact that impulses do not push out [m]; 0: none"""
    @property
    def overlap_body(self) -> Optional[str]:
        """a body of that contact, or None"""
    @property
    def creep(self) -> float:
        """farthest that a contact by impulses has slid while friction holds it [m]; 0: none"""
    @property
    def creep_body(self) -> Optional[str]:
        """a body of that contact, or None"""
    @property
    def unsolved_body(self) -> Optional[str]:
        """with time_stepping, a body whose impulses were not solved, or None; solver_residual says how far"""
    @property
    def energy(self) -> float:
        """kinetic energy + potential energy of gravity and springs [J]"""
    @property
    def energy_drift(self) -> float:
        """change of energy since the last edit over the largest kinetic energy [1]"""
    @property
    def energy_rise(self) -> float:
        """rise of an island's energy without a cause [J]; 0: none"""
    @property
    def local_error(self) -> Optional[float]:
        """largest error estimate of an island for this step [m]; None where an island has none,
        as where impulses were not solved"""
    @property
    def dependent_rows(self) -> int:
        """redundant equations, at most at once"""
    @property
    def unresolved_bodies(self) -> int:
        """bodies of stiff islands that move faster than the step resolves"""
    @property
    def torn_joints(self) -> int:
        """joints that broke in this step"""
    @property
    def projected_energy(self) -> float:
        """kinetic energy lost where velocities were projected onto the joints [J]"""
    @property
    def correction_work(self) -> float:
        """work of closing errors where impulses advance islands: weight times the distance moved
        [J]"""
    @property
    def driven_work(self) -> float:
        """work of wrenches, motors and kinematic bodies where impulses advance islands [J]"""
    @property
    def solver_residual(self) -> float:
        """largest |J V - target| that the sweeps left [m/s]"""
    @property
    def failed(self) -> bool:
        """the world kept the state before the step"""
    @property
    def failure(self) -> str:
        """reason why the step failed; empty where it did not"""
    @property
    def failed_body(self) -> Optional[str]:
        """body whose motion failed, or None where the failure is not of a single body"""
    @property
    def stopped(self) -> bool:
        """a stop flag ended the step early: the world kept the state before it; C++ alone can
        set one"""
    @property
    def islands(self) -> Dict[str, int]:
        """islands advanced by each method"""
    @property
    def asleep(self) -> int:
        """islands at rest, left out"""
    @property
    def changes(self) -> int:
        """changes of method"""
    @property
    def handed_over(self) -> int:
        """islands whose contacts go from events to impulses"""
    @property
    def substeps(self) -> int:
        """substeps of all islands"""
    @property
    def events(self) -> int:
        """events at which a one-sided row began or ceased to act"""
    @property
    def hits(self) -> int:
        """hits of fast bodies, at their times within the step"""
    @property
    def rejected(self) -> int:
        """rejected substeps"""
    @property
    def evaluations(self) -> int:
        """evaluations of the equations of motion in explicit substeps"""
    @property
    def iterations(self) -> int:
        """sweeps over the rows, and Newton iterations"""
    @property
    def rows(self) -> int:
        """scalar equations solved"""
    @property
    def contacts(self) -> int:
        """contact points of islands that are awake"""
    @property
    def candidate_pairs(self) -> int:
        """pairs after the broadphase"""


class RunReport:
    """Outcome of World.run: worst values over its steps, sums, and samples."""
    @property
    def steps(self) -> int:
        """steps taken"""
    @property
    def failed(self) -> bool:
        """a step failed: the run ended with the state before it"""
    @property
    def failure(self) -> str:
        """reason; empty where no step failed"""
    @property
    def failed_body(self) -> Optional[str]:
        """body whose motion failed, or None where the failure is not of a single body"""
    @property
    def timed_out(self) -> bool:
        """time_limit was reached before the end"""
    @property
    def wall_time(self) -> float:
        """run time of the steps alone [s]"""
    @property
    def max_constraint_error(self) -> float:
        """largest over all steps [m]"""
    @property
    def max_closing_error(self) -> float:
        """largest StepReport.closing_error [m]"""
    @property
    def max_penetration(self) -> float:
        """largest over all steps [m]"""
    @property
    def accumulated_local_error(self) -> Optional[float]:
        """sum of the steps' estimates [m]; None where a step had none"""
    @property
    def energy_initial(self) -> float:
        """before the first step [J]"""
    @property
    def energy_final(self) -> float:
        """after the last step [J]"""
    @property
    def energy_drift(self) -> float:
        """StepReport.energy_drift of the last step [1]"""
    @property
    def correction_work(self) -> float:
        """work of closing errors where impulses advance islands, sum over all steps [J]"""
    @property
    def driven_work(self) -> float:
        """work of wrenches, motors and kinematic bodies where impulses advance islands, sum over
        all steps [J]"""
    @property
    def solver_residual(self) -> float:
        """largest |J V - target| that the sweeps left, over all steps [m/s]"""
    @property
    def methods(self) -> Set[str]:
        """methods that advanced an island"""
    @property
    def unresolved_bodies(self) -> Set[str]:
        """names of bodies that moved faster than a step resolves"""
    @property
    def unclosed_joints(self) -> Set[str]:
        """names of joints that were off by more than 1e-3 m, or 0.5 rad, and not being closed at
        some step"""
    @property
    def energy_rise(self) -> float:
        """largest rise of an island's energy without a cause [J]; 0: none"""
    @property
    def overlap(self) -> float:
        """largest StepReport.overlap [m]; 0: none"""
    @property
    def creep(self) -> float:
        """largest StepReport.creep [m]; 0: none"""
    @property
    def substeps(self) -> int:
        """sum over all steps"""
    @property
    def rejected(self) -> int:
        """rejected substeps, sum over all steps"""
    @property
    def iterations(self) -> int:
        """sum over all steps"""
    @property
    def rows(self) -> int:
        """sum over all steps"""
    @property
    def contacts(self) -> int:
        """sum over all steps"""
    @property
    def torn_joints(self) -> int:
        """joints that broke"""
    @property
    def changes(self) -> int:
        """changes of method"""
    @property
    def dependent_rows(self) -> int:
        """redundant equations, at most at once"""
    @property
    def times(self) -> Optional[np.ndarray]:
        """times of the samples [s], shape (samples,); or None"""
    @property
    def states(self) -> Optional[np.ndarray]:
        """samples of all bodies, shape (samples, bodies, 13) as World.states; or None"""


class VerifiedFigures(TypedDict):
    time: float                      # simulated [s]
    estimate: Optional[float]        # sum of the local error estimates [m]; None: no method has one
    growth: float                    # distance to the perturbed twin over its perturbation [1]
    global_error: Optional[float]    # estimate times growth [m]
    half_step: Optional[float]       # distance to the run with half the time step [m]; None: left out
    other_method: Optional[float]    # distance to the run by the other method [m]; None: left out
    other_error: Optional[float]     # largest distance of the other method's runs with whole and half step [m]


class VerifiedBody(TypedDict):
    # the keys of VerifiedFigures
    time: float
    estimate: Optional[float]
    growth: float
    global_error: Optional[float]
    half_step: Optional[float]
    other_method: Optional[float]
    other_error: Optional[float]
    verdict: str                         # holds, chaotic or exceeds
    exceeded: Optional[VerifiedFigures]  # where a difference first exceeded what is allowed
    chaotic_from: Optional[float]        # simulated [s]; the figures above end there
    unresolved: bool                     # moved faster than a step resolves
    no_estimate: str                     # why the body has no error estimate; empty: it has one
    no_half_step: str                    # why the half time step was left out; empty: it was not
    no_other_method: str                 # why the other method was left out; empty: it was not


class VerifyReport:
    """Outcome of World.verify. str() is a table."""
    @property
    def ticks(self) -> int:
        """ticks done by all runs"""
    @property
    def time_step(self) -> float:
        """time step of the verified run [s]"""
    @property
    def perturbation(self) -> float:
        """actual perturbation of the twin [m]"""
    @property
    def method(self) -> str:
        """method requested by the options"""
    @property
    def other_method(self) -> str:
        """method requested for the other run"""
    @property
    def bodies(self) -> Dict[str, VerifiedBody]:
        """dict by name of the dynamic bodies: dicts of time [s], estimate [m], growth,
        global_error [m], half_step [m], other_method [m], other_error [m], verdict ('holds',
        'chaotic', 'exceeds'), exceeded, chaotic_from [s], and why something is None"""
    @property
    def exceeds(self) -> bool:
        """whether a difference of any body exceeds what its estimate and growth allow"""
    @property
    def failure(self) -> str:
        """reason why the runs ended early; empty otherwise"""


class RobotDynamics:
    """Dynamics M qdd + b = force + p of a robot at the state in which World.robot_dynamics read it.
    Independent of the world."""
    @property
    def coordinates(self) -> List[RobotCoordinate]:
        """Coordinates in their order."""
    @property
    def followers(self) -> List[RobotFollower]:
        """Coordinates that follow others by couplings."""
    @property
    def bodies(self) -> List[str]:
        """Names of the bodies in the order of adding."""
    @property
    def pose_error(self) -> float:
        """Largest error of a joint, which is left out: distance [m] plus angle [rad]."""
    @property
    def position(self) -> np.ndarray:
        """Positions of the coordinates [m or rad], shape (n,); NaN for turns by three angles."""
    @property
    def velocity(self) -> np.ndarray:
        """Rates of the coordinates [m/s or rad/s], shape (n,)."""
    @property
    def mass_matrix(self) -> np.ndarray:
        """M, symmetric, shape (n, n) [kg, kg m or kg m^2]."""
    @property
    def bias(self) -> np.ndarray:
        """b: Coriolis and centrifugal forces, of a moving base, and gravity, shape (n,) [N or N m]."""
    @property
    def gravity(self) -> np.ndarray:
        """Forces that carry the weights at rest, part of bias, shape (n,) [N or N m]."""
    @property
    def passive(self) -> np.ndarray:
        """p: forces of stiffness and damping of the coordinates, shape (n,) [N or N m]."""
    def motion_of(self, body: str, point: Optional[Vector] = ...) -> PointMotion:
        """motion_of(body, point=(0, 0, 0) [m] in the body's frame)

        Motion of a point fixed on a body, or of a frame there, in world axes. The acceleration is
        jacobian @ qdd + bias."""
    def inverse_dynamics(self, acceleration: Vector) -> np.ndarray:
        """inverse_dynamics(acceleration)

        Forces M qdd + b - p [N or N m] for accelerations qdd [m/s^2 or rad/s^2], shape (n,)."""
    def forward_dynamics(self, force: Vector) -> np.ndarray:
        """forward_dynamics(force)

        Accelerations [m/s^2 or rad/s^2] by forces along the coordinates [N or N m], shape (n,)."""
    def linearize(self, force: Vector) -> Linearization:
        """linearize(force)

        Derivatives at the present state and forces [N or N m], analytical: d/dt (dq, dqd) =
        A (dq, dqd) + B dforce. Of turns by three angles dq is a rotation vector in axes of the
        body farther from the base."""


class World:
    """World(**options)

    Bodies, joints and their motion. Options as in docs/scenes.md: gravity [m/s^2], time_step
    [s], method, tolerance [m/s], order, ... Bad input raises ValueError naming field and value
    and changes nothing. Different worlds may be stepped on different threads; one world by one
    thread at a time."""
    def __init__(self, *, gravity: Vector = ..., time_step: float = ..., method: str = ...,
                 closing_time: float = ..., sleep_after: float = ..., sleep_speed: float = ...,
                 threads: int = ..., order: int = ..., tolerance: float = ...,
                 stiff_order: int = ..., dissipation: bool = ..., stiffness_limit: float = ...,
                 iterations: int = ..., warm_starting: bool = ...,
                 contact_tolerance: float = ..., event_work: float = ...,
                 baumgarte: float = ...) -> None:
        ...
    @property
    def options(self) -> Dict[str, Any]:
        """All options, as a dict."""
    def set_options(self, *, gravity: Vector = ..., time_step: float = ..., method: str = ...,
                    closing_time: float = ..., sleep_after: float = ..., sleep_speed: float = ...,
                    threads: int = ..., order: int = ..., tolerance: float = ...,
                    stiff_order: int = ..., dissipation: bool = ..., stiffness_limit: float = ...,
                    iterations: int = ..., warm_starting: bool = ...,
                    contact_tolerance: float = ..., event_work: float = ...,
                    baumgarte: float = ...
                    ) -> None:
        """set_options(**options)

        Sets the options that are named and keeps the others."""

    def copy(self) -> World:
        """A snapshot: an independent world that goes on with the same bits."""
    def __copy__(self) -> World: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> World: ...
    def restore(self, snapshot: World) -> None:
        """Becomes a copy of a snapshot; arrays follow."""

    def add_body(self, name: str, *, type: str = ..., shape: Shape = ..., mass: float = ...,
                 inertia: Vector = ..., position: Vector = ..., orientation: Vector = ...,
                 linear_velocity: Vector = ..., angular_velocity: Vector = ...,
                 friction: float = ..., restitution: float = ..., no_collision: bool = ...,
                 collision_groups: int = ..., collision_mask: int = ...,
                 gravity_compensation: float = ...,
                 shape_pose: Optional[Mapping[str, Vector]] = ...) -> None:
        """add_body(name, *, type='dynamic', shape=Point(), mass [kg], inertia=(0, 0, 0) [kg m^2]
        principal, zero: from the shape, position [m], orientation x y z w, linear_velocity
        [m/s], angular_velocity [rad/s] in world axes, friction=0, restitution=0,
        no_collision=False, collision_groups=1, collision_mask=0xffffffff: bits of the groups of
        the body, and of those with which it collides; gravity_compensation=0, share of the weight
        that nothing has to carry, shape_pose=None: a dict of position [m] and orientation (x, y,
        z, w) of a sphere, box, cylinder, capsule or hull in the body's frame; the shapes of a
        Compound have their own)

        Adds a body. Raises ValueError naming field and value."""
    def remove_body(self, name: str) -> List[str]:
        """Removes a body and its joints; returns the names of those joints."""
    def body(self, name: str) -> Dict[str, Any]:
        """The body as it was added: the keywords of add_body."""
    def state(self, name: str) -> State:
        """State now: position [m], orientation x y z w, linear_velocity [m/s], angular_velocity
        [rad/s], world axes."""
    def set_state(self, name: str, *, position: Vector = ..., orientation: Vector = ...,
                  linear_velocity: Vector = ..., angular_velocity: Vector = ...) -> None:
        """set_state(name, *, position [m], orientation x y z w, linear_velocity [m/s],
        angular_velocity [rad/s])

        Sets the given parts and keeps the others."""
    @property
    def body_names(self) -> List[str]:
        """Names in the order of adding, which is the order of rows of the arrays."""
    def index(self, name: str) -> int:
        """Row of a body in the arrays."""

    @property
    def states(self) -> np.ndarray:
        """Positions, orientations, linear and angular velocities, shape (bodies, 13).

        A read-only view, no copy: it follows the world until a body is added or removed, then
        keeps the last state. Its memory outlives the world."""
    @property
    def positions(self) -> np.ndarray:
        """Centres of mass, world [m], shape (bodies, 3).

        A read-only view, no copy: it follows the world until a body is added or removed, then
        keeps the last state. Its memory outlives the world."""
    @property
    def orientations(self) -> np.ndarray:
        """Orientations, body to world, x y z w, shape (bodies, 4).

        A read-only view, no copy: it follows the world until a body is added or removed, then
        keeps the last state. Its memory outlives the world."""
    @property
    def linear_velocities(self) -> np.ndarray:
        """Velocities of the centres of mass, world [m/s], shape (bodies, 3).

        A read-only view, no copy: it follows the world until a body is added or removed, then
        keeps the last state. Its memory outlives the world."""
    @property
    def angular_velocities(self) -> np.ndarray:
        """Angular velocities, world axes [rad/s], shape (bodies, 3).

        A read-only view, no copy: it follows the world until a body is added or removed, then
        keeps the last state. Its memory outlives the world."""

    def add_joint(self, name: str, *, type: str = ..., body_a: str = ..., anchor_a: Vector = ...,
                  body_b: str = ..., anchor_b: Vector = ..., axis_a: Vector = ...,
                  axis_b: Vector = ..., frame_a: Vector = ..., frame_b: Vector = ...,
                  length: Optional[float] = ...,
                  min_length: float = ..., max_length: float = ..., frequency: float = ...,
                  damping_ratio: float = ..., stiffness: float = ..., damping: float = ...,
                  baumgarte: Optional[float] = ..., break_force: float = ...,
                  break_torque: float = ..., collide_connected: bool = ..., enabled: bool = ...,
                  broken: bool = ...,
                  motor: Optional[Mapping[str, Optional[float]]] = ..., lower: float = ...,
                  upper: float = ..., limit_restitution: float = ..., friction: float = ...,
                  rest: float = ..., position: Optional[float] = ..., zero: float = ...,
                  coordinates: Sequence[Mapping[str, Any]] = ..., free: bool = ...,
                  joints: Sequence[str] = ..., ratio: float = ..., value: Optional[float] = ...,
                  pitch: float = ...) -> None:
        """add_joint(name, *, type='distance', 'ball', 'hinge', 'slider', 'cylindrical',
        'planar', 'universal', 'weld', 'point_on_line', 'point_on_plane' or 'parallel',
        body_a='world', anchor_a=(0, 0, 0) [m] in the body's frame, body_b='world', anchor_b, for
        types with axes axis_a=(0, 0, 1) and axis_b or frame_a and frame_b (x, y, z, w),
        length=None [m] None: the present distance, min_length=0, max_length=inf [m], frequency
        [Hz] and damping_ratio, or stiffness [N/m] and damping [N s/m], baumgarte=None,
        break_force=0 [N], break_torque=0 [N m], collide_connected=False, enabled=True,
        broken=False, motor={}; of types with free coordinates, for the first: lower, upper [m or
        rad], limit_restitution=0, friction, damping, stiffness, rest, frequency, damping_ratio,
        position, motor; or coordinates=[{...}, ...], these for each)

        Adds a joint; the motor's keywords are those of set_motor."""
    def remove_joint(self, name: str) -> None:
        """Removes a joint."""
    def joint(self, name: str) -> Dict[str, Any]:
        """The joint with its length and stiffness filled in: the keywords of add_joint."""
    def joint_state(self, name: str) -> JointState:
        """State after the last step: error [m], error_rate [m/s], angle_error [rad], force [N]
        along the joint, < 0 is tension, bias and reached_rate [m/s], travel of the motor [m],
        saturated, broken, closing, and coordinates, a list of those that are free: position,
        velocity, bias [m or rad, a second], effort [N or N m] of what acts along each. The errors
        of a custom joint are None where its function fails."""
    def joint_wrench(self, name: str) -> JointWrench:
        """Wrench of the joint on body B, mean over the last step: force [N], and torque [N m] about
        anchor B, in the joint's frame on B, or in the body's frame for types without axes."""
    def opening(self, name: str) -> str:
        """How far a joint that closes is open now, in words; '' where it fits."""
    @property
    def joint_names(self) -> List[str]:
        """In the order of adding."""
    def set_motor(self, name: str, *, bias: float = ..., amplitude: float = ...,
                  frequency: float = ..., phase: float = ..., max_force: float = ...,
                  timeout: float = ..., coordinate: int = ...,
                  position: Optional[float] = ..., servo_frequency: float = ...,
                  servo_damping_ratio: float = ..., servo_stiffness: float = ...,
                  servo_damping: float = ..., force: Optional[float] = ...,
                  removed: bool = ...) -> None:
        """set_motor(name, *, bias=0 [m/s or rad/s] > 0 lengthens or turns positively about the
        axis, amplitude=0 [m/s or rad/s], frequency=0 [Hz], phase=0 [rad], max_force=0 [N or N m]
        0: no limit, timeout=0 [s] 0: never), and of types with free coordinates coordinate=0,
        position=None [m or rad], servo_frequency=0 [Hz], servo_damping_ratio=1,
        servo_stiffness=0, servo_damping=0, force=None [N or N m], removed=False: free from now
        on

        Replaces the motor; its timeout counts from now."""
    def set_joint(self, name: str, *, baumgarte: Optional[float] = ..., break_force: float = ...,
                  break_torque: float = ..., collide_connected: bool = ..., enabled: bool = ...,
                  length: Optional[float] = ..., min_length: float = ..., max_length: float = ...,
                  frequency: float = ..., damping_ratio: float = ..., stiffness: float = ...,
                  damping: float = ..., coordinate: int = ..., lower: float = ...,
                  upper: float = ..., limit_restitution: float = ..., friction: float = ...,
                  rest: float = ..., position: Optional[float] = ..., zero: float = ...,
                  motor: Optional[Mapping[str, Optional[float]]] = ...) -> str:
        """set_joint(name, *, baumgarte, break_force, break_torque, collide_connected, enabled;
        of a distance joint length, min_length, max_length, frequency, damping_ratio, stiffness,
        damping, motor; of types with free coordinates coordinate=0, and of that one lower,
        upper, limit_restitution, friction, damping, stiffness, rest, frequency, damping_ratio,
        position, motor={...} or None)

        Sets the given settings and keeps the others; returns opening(): an error that the joint
        then has is closed."""
    def set_broken(self, name: str, broken: bool) -> None:
        """Marks a joint as broken, or whole again."""
    def set_enabled(self, name: str, enabled: bool) -> str:
        """Disables a joint, which then does not act, or enables it again, and returns opening():
        an error that it then has is closed."""

    def add_wrench(self, body: str, *, force: Vector = ..., torque: Vector = ...,
                   start: float = ..., duration: float = ...) -> None:
        """add_wrench(body, *, force=(0, 0, 0) [N], torque=(0, 0, 0) [N m], start=now [s],
        duration=inf [s])

        Force at the centre of mass and torque, world axes, for an interval of simulated time.
        Several add up."""
    def clear_wrenches(self, body: str) -> None:
        """Removes all wrenches of a body."""

    def step(self) -> StepReport:
        """Advances the world by one tick, without the GIL; returns its StepReport."""
    def run(self, duration: float, *, every: int = ..., time_limit: float = ...) -> RunReport:
        """run(duration [s], *, every=0, time_limit=inf [s])

        Advances the world by this simulated time, to the nearest tick, without the GIL; ends
        early when a step fails or the run time exceeds time_limit. With `every` the RunReport
        has samples: the start and each `every`-th tick."""
    def verify(self, duration: float, *, perturbation: float = ..., least: float = ...,
               margin: float = ...) -> VerifyReport:
        """verify(duration [s], *, perturbation=1e-10 [m], least=1e-6 [m], margin=100)

        Runs copies of the world for this simulated time: as it is, with half the time step, by
        another method, and from a perturbed state; compares the differences of each body with
        its error estimate times the growth of the perturbation (docs/verify.md). The world stays
        as it is."""
    @property
    def report(self) -> StepReport:
        """StepReport of the last step."""
    @property
    def time(self) -> float:
        """Simulated time [s]."""
    @property
    def step_count(self) -> int:
        """Steps since the start."""
    @property
    def energy(self) -> float:
        """Kinetic energy + potential energy of gravity and springs, now [J]."""
    @property
    def state_hash(self) -> int:
        """64-bit hash of time, bodies, joints, wrenches and their state, as constraint_sim_run
        prints it."""
    def reset(self) -> None:
        """Returns bodies and joints to what they were when added; time goes on."""
    def set_time(self, time: float, step_count: int) -> None:
        """Continues from this simulated time [s] and step."""

    def ray(self, origin: Vector, direction: Vector, *, max_distance: float = ...,
            ignored: Sequence[str] = ...) -> Optional[RayHit]:
        """ray(origin, direction, *, max_distance=inf [m], ignored=())

        The first body that a ray hits, world frame; None without one. A dict of body, distance
        [m], point [m], normal, inside. The direction may have any length > 0. Every body with a
        shape is seen, with no_collision too, but those named in ignored. A ray that starts inside
        a body hits it at distance 0, with inside=True and a normal against the ray."""
    def closest_points(self, body_a: str, body_b: str) -> ClosestPoints:
        """Closest points of two bodies, world frame: a dict of distance [m], point_a and point_b
        on their surfaces [m], and normal, unit, from B to A. The distance of bodies that overlap
        is negative: the least translation that separates them."""
    def bodies_in(self, min: Vector, max: Vector) -> List[str]:
        """bodies_in(min, max)

        Names of the bodies whose bounding boxes along the world's axes share a point with the box
        between two corners [m], in the order of adding. A plane is the half-space below it."""
    def islands(self) -> List[Island]:
        """Islands with method, reason and cost, as of the last step; before the first as it
        begins."""
    def contacts(self) -> List[Contact]:
        """Contact points of the last step: bodies, position [m], normal from B to A, depth [m],
        normal_force [N], force of both normal and friction on A [N], state, and the number of
        the shape of each body that touches, part_a and part_b."""
    def events(self) -> List[Event]:
        """Events of the last step, in the order of time: kind ('broken', 'rope_taut',
        'rope_slack', 'limit_reached', 'limit_left', 'saturated', 'released', 'slips', 'sticks',
        'contact_began', 'contact_ended', 'hit', 'handed_over', 'taken_back'), time [s], bodies,
        joint or None of a contact or an island, coordinate of the joint or None, impulse of an
        impact [N s or N m s]."""
    def unresolved_bodies(self) -> List[str]:
        """Names of bodies of stiff islands that the last step was too long to resolve."""
    def step_warnings(self) -> List[StepWarning]:
        """Warnings of the last step, as dicts: kind ('unclosed', 'energy_rise', 'hits_left',
        'overlap', 'creep', 'unsolved', 'unresolved', 'handed_over'), name of the joint or body,
        value, unit ('' of a number), advice, is_notice where the result is still trustworthy, and
        text, one line with the advice. Empty between an edit and the next step."""
    def explain(self) -> str:
        """Plan: what the world uses, what it leaves out and why, as YAML."""
    def left_out(self) -> List[str]:
        """Parts of the engine that the world leaves out and why, one line each."""
    def doubtful_settings(self) -> List[str]:
        """Settings that may be mistakes, one line each: inertias that no distribution of mass
        has."""
    def add_urdf(self, text: str, prefix: str = ..., position: Vector = ...,
                 orientation: Vector = ..., fixed: bool = ..., extra: str = ...,
                 srdf: str = ...) -> Dict[str, Any]:
        """add_urdf(text, prefix='', position=(0, 0, 0) [m], orientation=(0, 0, 0, 1) x y z w,
        fixed=False, extra='', srdf='')

        Adds the robot of a URDF or an SDF; `extra` is the YAML of docs/robots.md. Returns a dict of its
        name, the names of bodies and constraints, links by name with body, position [m] and
        orientation in the body, fixed_joints that move no mass, and warnings: all that deviates
        from the URDF. Raises ValueError and adds nothing where the robot is rejected."""
    def add_urdf_file(self, path: str, prefix: str = ..., position: Vector = ...,
                      orientation: Vector = ..., fixed: bool = ...,
                      extra: Optional[str] = ...) -> Dict[str, Any]:
        """add_urdf_file(path, prefix='', position=(0, 0, 0) [m], orientation=(0, 0, 0, 1) x y z w,
        fixed=False, extra=None)

        The same of a file, with the .yaml and .srdf of the same name beside it; an `extra`
        replaces the YAML."""
    def robot_dynamics(self, body: Union[str, Sequence[str]]) -> RobotDynamics:
        """robot_dynamics(body)

        RobotDynamics at the present state of the robot that has this dynamic body, or these: a list
        of names, such as `bodies` of add_urdf, of which those that are not dynamic are ignored. It
        has all bodies that acting joints connect. Motors, limits, friction, contacts and wrenches
        are left out. Raises ValueError naming joint or body where the joints form no tree."""
    def save_scene(self) -> str:
        """The world as it is now, as text of a scene; every number to 4 ulp."""
    def save_scene_file(self, path: str) -> None:
        """Saves the scene that save_scene() returns into a file."""


def load_scene(text: str, source: str = ..., **defaults: Any) -> World:
    """load_scene(text, source='scene', **defaults)

    World of a scene in YAML (docs/scenes.md). `source` names it in errors; `defaults` are
    options that hold where the scene sets none. Raises SceneError, a ValueError, with line, key
    and value."""
def load_scene_file(path: str, **defaults: Any) -> World:
    """load_scene_file(path, **defaults)

    World of a scene in a file, as load_scene."""
def verify(scene: str, duration: float, *, perturbation: float = ..., least: float = ...,
           margin: float = ..., **defaults: Any) -> VerifyReport:
    """verify(scene, duration [s], *, perturbation=1e-10 [m], least=1e-6 [m], margin=100,
    **defaults)

    World.verify of a scene in YAML."""
