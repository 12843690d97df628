"""The engine of constraint_sim: worlds of rigid bodies, stepped without ROS. SI units, world axes,
quaternions as x y z w."""
from typing import Any, Dict, List, Mapping, Optional, Sequence, Set, Tuple, TypedDict, Union

import numpy as np

__version__: str
METHODS: Tuple[str, ...]

Vector = Sequence[float]
Tuple3 = Tuple[float, float, float]
Tuple4 = Tuple[float, float, float, float]


class SceneError(ValueError):
    """A scene that cannot be: `source:line: path.of.key: what is wrong, with the value`."""


class Point:
    """Touches nothing, and rotates only with an inertia."""
    def __init__(self) -> None: ...


class Sphere:
    """Centred on the body."""
    def __init__(self, radius: float) -> None: ...
    @property
    def radius(self) -> float: ...  # [m]


class Box:
    """Centred on the body; whole edge lengths along its axes."""
    def __init__(self, size: Vector) -> None: ...
    @property
    def size(self) -> Tuple3: ...  # [m]


class Plane:
    """Solid below the body's x-y plane; static and kinematic bodies only."""
    def __init__(self) -> None: ...


class Cylinder:
    """Centred on the body, along its z axis, with flat ends."""
    def __init__(self, radius: float, length: float) -> None: ...
    @property
    def radius(self) -> float: ...  # [m]
    @property
    def length(self) -> float: ...  # [m]


Shape = Union[Point, Sphere, Box, Plane, Cylinder]


class State(TypedDict):
    position: Tuple3          # centre of mass, world [m]
    orientation: Tuple4       # body to world, x y z w
    linear_velocity: Tuple3   # world [m/s]
    angular_velocity: Tuple3  # world [rad/s]


class CoordinateState(TypedDict):
    position: float  # whole turns counted [m or rad]
    velocity: float  # [m/s or rad/s]
    effort: float    # of what acts along it, mean over the step [N or N m]
    bias: float      # asked of its motor [m/s or rad/s]


class JointWrench(TypedDict):
    force: Tuple3   # on body B, in the joint's frame on B [N]
    torque: Tuple3  # about anchor B [N m]


class JointState(TypedDict):
    error: float         # [m]
    error_rate: float    # [m/s]
    angle_error: float   # of joints with axes [rad]
    force: float         # along the joint, mean over the step [N]; < 0 is tension
    bias: float          # asked of the motor [m/s]
    reached_rate: float  # [m/s]
    travel: float        # that the motor has added to the length [m]
    saturated: bool
    broken: bool
    closing: bool
    coordinates: List[CoordinateState]  # that are free, as docs/joints.md numbers them


class Island(TypedDict):
    first_body: str
    bodies: int
    joints: int
    method: str
    why: str
    local_error: Optional[float]  # [m]; None of impulses
    substeps: int
    rejected: int
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


class Event(TypedDict):
    kind: str                  # broken, rope_taut, ..., contact_began, contact_ended, hit, handed_over, taken_back
    time: float                # simulated [s]
    body_a: str                # that touch, or that the joint connects; 'world' for the world
    body_b: str                # of an island its first two; of a body alone that one twice
    joint: Optional[str]       # whose it is; None of a contact or an island
    coordinate: Optional[int]  # of the joint; None of a length, of what broke, of a contact or an island
    impulse: float             # of the impact that it came with [N s or N m s]


class StepReport:
    """What one step did. A copy: it keeps its values when the world steps on."""
    @property
    def step(self) -> int: ...
    @property
    def time(self) -> float: ...  # [s]
    @property
    def max_constraint_error(self) -> float: ...  # [m]
    @property
    def worst_joint(self) -> Optional[str]: ...
    @property
    def closing_error(self) -> float: ...  # of joints that an edit or a motor is closing [m]
    @property
    def closing_joint(self) -> Optional[str]: ...
    @property
    def unclosed_joints(self) -> int: ...  # off by more than 1e-3 m, not being closed
    @property
    def max_penetration(self) -> float: ...  # [m]
    @property
    def overlap(self) -> float: ...  # of a contact that impulses do not push out [m]
    @property
    def overlap_body(self) -> Optional[str]: ...
    @property
    def creep(self) -> float: ...  # of a contact by impulses that friction holds [m]
    @property
    def creep_body(self) -> Optional[str]: ...
    @property
    def energy(self) -> float: ...  # [J]
    @property
    def energy_drift(self) -> float: ...  # over the largest kinetic energy [1]
    @property
    def energy_rise(self) -> float: ...  # without a cause [J]
    @property
    def local_error(self) -> Optional[float]: ...  # [m]; None with impulses
    @property
    def dependent_rows(self) -> int: ...
    @property
    def unresolved_bodies(self) -> int: ...
    @property
    def torn_joints(self) -> int: ...
    @property
    def projected_energy(self) -> float: ...  # [J]
    @property
    def correction_work(self) -> float: ...  # [J]
    @property
    def driven_work(self) -> float: ...  # [J]
    @property
    def solver_residual(self) -> float: ...  # [m/s]
    @property
    def failed(self) -> bool: ...
    @property
    def failure(self) -> str: ...
    @property
    def failed_body(self) -> Optional[str]: ...
    @property
    def stopped(self) -> bool: ...
    @property
    def islands(self) -> Dict[str, int]: ...  # by method
    @property
    def asleep(self) -> int: ...
    @property
    def changes(self) -> int: ...
    @property
    def handed_over(self) -> int: ...  # islands whose contacts go from events to impulses
    @property
    def substeps(self) -> int: ...
    @property
    def events(self) -> int: ...  # at which a one-sided row began or ceased to act
    @property
    def hits(self) -> int: ...  # of fast bodies, at their times within the step
    @property
    def rejected(self) -> int: ...
    @property
    def iterations(self) -> int: ...
    @property
    def rows(self) -> int: ...
    @property
    def contacts(self) -> int: ...
    @property
    def candidate_pairs(self) -> int: ...


class RunReport:
    """Outcome of World.run: worst values over its steps, sums, and samples."""
    @property
    def steps(self) -> int: ...
    @property
    def failed(self) -> bool: ...
    @property
    def failure(self) -> str: ...
    @property
    def failed_body(self) -> Optional[str]: ...
    @property
    def timed_out(self) -> bool: ...
    @property
    def wall_time(self) -> float: ...  # of the steps alone [s]
    @property
    def max_constraint_error(self) -> float: ...  # [m]
    @property
    def max_closing_error(self) -> float: ...  # [m]
    @property
    def max_penetration(self) -> float: ...  # [m]
    @property
    def accumulated_local_error(self) -> Optional[float]: ...  # [m]; None with impulses
    @property
    def energy_initial(self) -> float: ...  # [J]
    @property
    def energy_final(self) -> float: ...  # [J]
    @property
    def energy_drift(self) -> float: ...  # [1]
    @property
    def correction_work(self) -> float: ...  # [J]
    @property
    def driven_work(self) -> float: ...  # [J]
    @property
    def solver_residual(self) -> float: ...  # [m/s]
    @property
    def methods(self) -> Set[str]: ...
    @property
    def unresolved_bodies(self) -> Set[str]: ...
    @property
    def unclosed_joints(self) -> Set[str]: ...  # off by more than 1e-3 m, not being closed at some step
    @property
    def energy_rise(self) -> float: ...  # without a cause, largest of all steps [J]
    @property
    def overlap(self) -> float: ...  # largest of all steps [m]
    @property
    def creep(self) -> float: ...  # largest of all steps [m]
    @property
    def substeps(self) -> int: ...
    @property
    def rejected(self) -> int: ...
    @property
    def iterations(self) -> int: ...
    @property
    def rows(self) -> int: ...
    @property
    def contacts(self) -> int: ...
    @property
    def torn_joints(self) -> int: ...
    @property
    def changes(self) -> int: ...
    @property
    def dependent_rows(self) -> int: ...
    @property
    def times(self) -> Optional[np.ndarray]: ...  # [s], (samples,)
    @property
    def states(self) -> Optional[np.ndarray]: ...  # (samples, bodies, 13)


class VerifiedFigures(TypedDict):
    time: float                      # simulated [s]
    estimate: Optional[float]        # sum of the local error estimates [m]; None: no method has one
    growth: float                    # of the perturbed twin [1]
    global_error: Optional[float]    # estimate times growth [m]
    half_step: Optional[float]       # distance to the run with half the time step [m]; None: left out
    other_method: Optional[float]    # distance to the run by the other method [m]; None: left out
    other_error: Optional[float]  # that run may be off by so much [m]


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
    no_estimate: str                     # why; empty: there is one
    no_half_step: str                    # why this comparison was left out; empty: it was not
    no_other_method: str                 # the same of the other method


class VerifyReport:
    """Outcome of World.verify. str() is a table."""
    @property
    def ticks(self) -> int: ...  # done by all runs
    @property
    def time_step(self) -> float: ...  # [s]
    @property
    def perturbation(self) -> float: ...  # of the twin [m]
    @property
    def method(self) -> str: ...
    @property
    def other_method(self) -> str: ...
    @property
    def bodies(self) -> Dict[str, VerifiedBody]: ...  # dynamic ones, in the order of adding
    @property
    def exceeds(self) -> bool: ...  # whether any body does
    @property
    def failure(self) -> str: ...  # why the runs ended early; empty: they did not


class World:
    """Bodies, joints and their motion. Options are those of docs/scenes.md. Bad input raises
    ValueError naming field and value, and changes nothing."""
    def __init__(self, *, gravity: Vector = ..., time_step: float = ..., method: str = ...,
                 closing_time: float = ..., sleep_after: float = ..., sleep_speed: float = ...,
                 threads: int = ..., order: int = ..., tolerance: float = ...,
                 stiff_order: int = ..., dissipation: bool = ..., stiffness_limit: float = ...,
                 iterations: int = ..., warm_starting: bool = ..., baumgarte: float = ...) -> None:
        ...
    @property
    def options(self) -> Dict[str, Any]: ...
    def set_options(self, *, gravity: Vector = ..., time_step: float = ..., method: str = ...,
                    closing_time: float = ..., sleep_after: float = ..., sleep_speed: float = ...,
                    threads: int = ..., order: int = ..., tolerance: float = ...,
                    stiff_order: int = ..., dissipation: bool = ..., stiffness_limit: float = ...,
                    iterations: int = ..., warm_starting: bool = ..., baumgarte: float = ...
                    ) -> None: ...

    def copy(self) -> World: ...
    def __copy__(self) -> World: ...
    def __deepcopy__(self, memo: Dict[int, Any]) -> World: ...
    def restore(self, snapshot: World) -> None: ...

    def add_body(self, name: str, *, type: str = ..., shape: Shape = ..., mass: float = ...,
                 inertia: Vector = ..., position: Vector = ..., orientation: Vector = ...,
                 linear_velocity: Vector = ..., angular_velocity: Vector = ...,
                 friction: float = ..., restitution: float = ..., no_collision: bool = ...,
                 shape_pose: Optional[Mapping[str, Vector]] = ...) -> None: ...
    def remove_body(self, name: str) -> List[str]: ...
    def body(self, name: str) -> Dict[str, Any]: ...
    def state(self, name: str) -> State: ...
    def set_state(self, name: str, *, position: Vector = ..., orientation: Vector = ...,
                  linear_velocity: Vector = ..., angular_velocity: Vector = ...) -> None: ...
    @property
    def body_names(self) -> List[str]: ...
    def index(self, name: str) -> int: ...

    @property
    def states(self) -> np.ndarray: ...  # (bodies, 13)
    @property
    def positions(self) -> np.ndarray: ...  # [m], (bodies, 3)
    @property
    def orientations(self) -> np.ndarray: ...  # x y z w, (bodies, 4)
    @property
    def linear_velocities(self) -> np.ndarray: ...  # [m/s], (bodies, 3)
    @property
    def angular_velocities(self) -> np.ndarray: ...  # [rad/s], (bodies, 3)

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
                  pitch: float = ...) -> None: ...
    def remove_joint(self, name: str) -> None: ...
    def joint(self, name: str) -> Dict[str, Any]: ...
    def joint_state(self, name: str) -> JointState: ...
    def joint_wrench(self, name: str) -> JointWrench: ...
    def opening(self, name: str) -> str: ...  # of a joint that closes, in words
    @property
    def joint_names(self) -> List[str]: ...
    def set_motor(self, name: str, *, bias: float = ..., amplitude: float = ...,
                  frequency: float = ..., phase: float = ..., max_force: float = ...,
                  timeout: float = ..., coordinate: int = ...,
                  position: Optional[float] = ..., servo_frequency: float = ...,
                  servo_damping_ratio: float = ..., servo_stiffness: float = ...,
                  servo_damping: float = ..., force: Optional[float] = ...,
                  removed: bool = ...) -> None: ...
    def set_joint(self, name: str, *, baumgarte: Optional[float] = ..., break_force: float = ...,
                  break_torque: float = ..., collide_connected: bool = ..., enabled: bool = ...,
                  length: Optional[float] = ..., min_length: float = ..., max_length: float = ...,
                  frequency: float = ..., damping_ratio: float = ..., stiffness: float = ...,
                  damping: float = ..., coordinate: int = ..., lower: float = ...,
                  upper: float = ..., limit_restitution: float = ..., friction: float = ...,
                  rest: float = ..., position: Optional[float] = ..., zero: float = ...,
                  motor: Optional[Mapping[str, Optional[float]]] = ...) -> str: ...
    def set_broken(self, name: str, broken: bool) -> None: ...
    def set_enabled(self, name: str, enabled: bool) -> str: ...  # opening(), once it acts again

    def add_wrench(self, body: str, *, force: Vector = ..., torque: Vector = ...,
                   start: float = ..., duration: float = ...) -> None: ...
    def clear_wrenches(self, body: str) -> None: ...

    def step(self) -> StepReport: ...
    def run(self, duration: float, *, every: int = ..., time_limit: float = ...) -> RunReport: ...
    def verify(self, duration: float, *, perturbation: float = ..., least: float = ...,
               margin: float = ...) -> VerifyReport: ...
    @property
    def report(self) -> StepReport: ...
    @property
    def time(self) -> float: ...  # [s]
    @property
    def step_count(self) -> int: ...
    @property
    def energy(self) -> float: ...  # [J]
    @property
    def state_hash(self) -> int: ...
    def reset(self) -> None: ...
    def set_time(self, time: float, step_count: int) -> None: ...

    def islands(self) -> List[Island]: ...
    def contacts(self) -> List[Contact]: ...
    def events(self) -> List[Event]: ...  # of the last step
    def unresolved_bodies(self) -> List[str]: ...
    def explain(self) -> str: ...
    def left_out(self) -> List[str]: ...
    def warnings(self) -> List[str]: ...
    def save_scene(self) -> str: ...
    def save_scene_file(self, path: str) -> None: ...


def load_scene(text: str, source: str = ..., **defaults: Any) -> World: ...
def load_scene_file(path: str, **defaults: Any) -> World: ...
def verify(scene: str, duration: float, *, perturbation: float = ..., least: float = ...,
           margin: float = ..., **defaults: Any) -> VerifyReport: ...
