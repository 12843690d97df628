"""RobotDynamics in Python: robots of URDFs, and controllers that use them."""
import ast
import pathlib
import subprocess
import sys

import numpy as np
import pytest

from constraint_sim import engine
from support import SOURCES

ARM = str(SOURCES / 'config/robots/arm.urdf')
JOINTS = ['shoulder_pan', 'shoulder_lift', 'elbow', 'wrist_1', 'wrist_2', 'wrist_3']


def arm(time_step=0.001, positions='{shoulder_lift: -1.2, elbow: 1.5, wrist_2: 0.4}'):
    """Returns a world with the arm on the floor, without motors, and the robot's dict."""
    world = engine.World(time_step=time_step, gravity=(0, 0, -9.81), tolerance=1e-10)
    robot = world.add_urdf_file(ARM, prefix='arm/', fixed=True, extra=f'positions: {positions}')
    return world, robot


def push(world, forces):
    for name, force in zip(JOINTS, forces):
        world.set_motor('arm/' + name, force=force)


def test_the_arm_of_a_urdf():
    """Names and order; a symmetric positive definite M; velocities of the tool by its Jacobian; a world that stays."""
    world, robot = arm()
    push(world, (1.0, -20.0, 5.0, 1.0, 0.5, 0.1))
    world.run(0.1)
    before = world.state_hash
    tool = robot['links']['arm/tool0']
    dynamics = world.robot_dynamics(tool['body'])
    assert [c['name'] for c in dynamics.coordinates] == ['arm/' + name for name in JOINTS]
    assert all(c['joint'] == c['name'] and c['coordinate'] == 0 and c['is_angle'] for c in dynamics.coordinates)
    assert set(dynamics.bodies) <= set(robot['bodies']) and dynamics.followers == []
    assert dynamics.pose_error < 1e-12
    for coordinate, q, qd in zip(dynamics.coordinates, dynamics.position, dynamics.velocity):
        state = world.joint_state(coordinate['name'])['coordinates'][0]
        assert coordinate['position'] == q == pytest.approx(state['position'], abs=1e-12)
        assert coordinate['velocity'] == qd == pytest.approx(state['velocity'], abs=1e-10)
    M = dynamics.mass_matrix
    assert M.shape == (6, 6) and np.array_equal(M, M.T) and np.linalg.eigvalsh(M).min() > 0.0
    motion = dynamics.motion_of(tool['body'], tool['position'])
    state = world.state(tool['body'])
    spin = np.array(state['angular_velocity'])
    x, y, z, w = state['orientation']
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    twist = np.concatenate([state['linear_velocity'] + np.cross(spin, turn @ tool['position']), spin])
    assert np.abs(motion['jacobian'] @ dynamics.velocity - twist).max() < 1e-11  # rounding of speeds of 1
    assert np.array_equal(motion['velocity'].shape, (6,)) and np.abs(twist).max() > 0.1
    force = np.arange(6.0)
    qdd = dynamics.forward_dynamics(force)
    assert np.abs(dynamics.inverse_dynamics(qdd) - force).max() < 1e-11
    assert np.abs(M @ qdd + dynamics.bias - dynamics.passive - force).max() < 1e-11
    assert world.state_hash == before
    world.step()
    assert dynamics.velocity[0] != world.joint_state('arm/shoulder_pan')['coordinates'][0]['velocity'], 'a value'


def test_linearization_predicts_the_next_step():
    """Worlds with other forces differ after 0.01 s by the integral of exp(A t) B, up to the change of A by then."""
    world, _ = arm(time_step=1e-3)
    dynamics = world.robot_dynamics(world.body_names[-1])
    force = dynamics.gravity + np.array([3.0, 2.0, 1.0, 0.2, 0.1, 0.02])
    push(world, force)
    linear = dynamics.linearize(force)
    assert linear['A'].shape == (12, 12) and linear['B'].shape == (12, 6)
    assert np.array_equal(linear['acceleration'], dynamics.forward_dynamics(force))

    def after(joint, change):
        copy = world.copy()
        copy.set_motor('arm/' + JOINTS[joint], force=force[joint] + change)
        copy.run(0.01)
        stepped = copy.robot_dynamics(copy.body_names[-1])
        return np.concatenate([stepped.position, stepped.velocity])

    A, h = linear['A'], 0.01
    term = series = h * np.eye(12)  # the integral of exp(A t); the damping of the last wrist makes |A| h = 2
    for k in range(2, 40):
        term = term @ A * (h / k)
        series = series + term
    for joint in range(6):
        change = (after(joint, 1e-4) - after(joint, -1e-4)) / 2e-4
        expected = series @ linear['B'][:, joint]
        # A and B change by some per mille in 0.01 s
        assert np.abs(change - expected)[6:].max() < 2e-3 * np.abs(expected[6:]).max()
        assert np.abs(change - expected)[:6].max() < 2e-3 * np.abs(expected[:6]).max()


def tracking_error(time_step):
    """Computed torque: q follows 0.4 sin(2 t) about its start. Returns the largest error of a joint [rad]."""
    world, _ = arm(time_step)
    body = world.body_names[-1]
    start = world.robot_dynamics(body).position
    push(world, world.robot_dynamics(body).gravity)
    worst = 0.0
    for tick in range(round(1.5 / time_step)):
        t = tick * time_step
        dynamics = world.robot_dynamics(body)
        wanted = start + 0.4 * (1.0 - np.cos(2.0 * t))
        error = wanted - dynamics.position
        rate_error = 0.8 * np.sin(2.0 * t) - dynamics.velocity
        worst = max(worst, np.abs(error).max())
        push(world, dynamics.inverse_dynamics(1.6 * np.cos(2.0 * t) + 100.0 * error + 20.0 * rate_error))
        assert not world.step().failed
    return worst


def test_computed_torque_tracks_a_trajectory():
    """Forces are held for a tick, so the error is of first order in it."""
    coarse, fine = tracking_error(0.004), tracking_error(0.002)
    assert coarse < 0.02
    assert 1.7 < coarse / fine < 2.4, (coarse, fine)


def test_gravity_compensation_holds_the_arm():
    """At rest with the forces of gravity, held for 1 s: only rounding moves the arm, which falls without."""
    world, _ = arm(0.01)
    dynamics = world.robot_dynamics(world.body_names[-1])
    falling = world.copy()
    push(world, dynamics.gravity)
    world.run(1.0)
    falling.run(1.0)
    moved = world.robot_dynamics(world.body_names[-1]).position - dynamics.position
    assert np.abs(moved).max() < 1e-9
    assert np.abs(falling.robot_dynamics(world.body_names[-1]).position - dynamics.position).max() > 0.5


def test_a_free_base():
    """The base of the quadruped has six coordinates; in free fall its legs have no weight to carry."""
    world = engine.World(time_step=0.002, gravity=(0, 0, -9.81))
    robot = world.add_urdf_file(str(SOURCES / 'config/robots/quadruped.urdf'), position=(0, 0, 5), extra='')
    dynamics = world.robot_dynamics(robot['bodies'][-1])
    base = dynamics.bodies[0]
    assert [c['name'] for c in dynamics.coordinates[:6]] == [
        f'{base}/{kind}_{axis}' for kind in ('linear', 'angular') for axis in 'xyz']
    assert [c['joint'] for c in dynamics.coordinates[:6]] == [None] * 6
    assert dynamics.coordinates[5]['position'] is None and np.isnan(dynamics.position[3:6]).all()
    assert np.allclose(dynamics.position[:3], world.state(base)['position'], atol=0.0)
    mass = sum(world.body(name)['mass'] for name in dynamics.bodies)
    assert dynamics.gravity[2] == pytest.approx(9.81 * mass, rel=1e-12)
    fall = dynamics.forward_dynamics(np.zeros(len(dynamics.coordinates)))
    # all bodies fall alike, so joints accelerate by their springs and dampers alone
    assert fall[:3] == pytest.approx((0.0, 0.0, -9.81), abs=1e-9)
    assert np.abs(fall[3:]).max() < 1e-8


def test_every_robot_of_the_repository():
    """Robots that are trees have a coordinate for each joint that neither follows nor is fixed, whatever joints keep
    bodies from colliding; robots with closed loops are rejected by the joint that closes one."""
    trees, loops = [], []
    for folder in ('config/robots', 'test/urdf/robots', 'examples'):
        for path in sorted((SOURCES / folder).glob('*.urdf')):
            for fixed in (False, True):
                world = engine.World(time_step=0.001)
                robot = world.add_urdf_file(str(path), fixed=fixed)
                world.run(0.02)
                types = [world.joint(name)['type'] for name in robot['constraints']]
                try:
                    dynamics = world.robot_dynamics(robot['bodies'])
                except ValueError as error:
                    loops.append(path.stem)
                    assert 'closes a loop' in str(error) or 'between two points' in str(error), (path, error)
                    continue
                trees.append(path.stem)
                has_base = dynamics.coordinates[0]['joint'] is None
                joints = sum(type in ('hinge', 'slider') for type in types)
                assert len(dynamics.coordinates) + len(dynamics.followers) == joints + 6 * has_base
                assert np.linalg.eigvalsh(dynamics.mass_matrix).min() > 0.0
                assert dynamics.pose_error < 1e-11
                bodies = [name for name in robot['bodies'] if world.body(name)['type'] == 'dynamic']
                assert dynamics.bodies == bodies
    assert {'arm', 'quadruped', 'arm6', 'gantry', 'quad12', 'picker'} == set(trees)
    assert {'gripper', 'fivebar', 'delta'} == set(loops)


def test_bad_input_is_named():
    world, robot = arm()
    world.add_body('wall', type='static', shape=engine.Plane())
    for body, why in (('nobody', 'nobody'), ('wall', "must be a dynamic body of the robot, got 'wall'")):
        with pytest.raises(ValueError, match=why):
            world.robot_dynamics(body)
    dynamics = world.robot_dynamics(world.body_names[-2])
    for bad, why in (([1.0], 'acceleration: must have 6 numbers'), (3.0, 'acceleration: must be a list of numbers'),
                     ([0, 0, 0, 0, 0, float('nan')], r'acceleration\[5\]'), ('abcdef', 'acceleration')):
        with pytest.raises(ValueError, match=why):
            dynamics.inverse_dynamics(bad)
    with pytest.raises(ValueError, match="body: must be a body of the robot of '.*', got 'wall'"):
        dynamics.motion_of('wall')
    with pytest.raises(ValueError, match='point'):
        dynamics.motion_of(dynamics.bodies[0], (1.0, 2.0))
    with pytest.raises(TypeError):
        engine.RobotDynamics()


def test_typed_dicts_of_robots():
    stubs = ast.parse((SOURCES / 'python/constraint_sim/engine.pyi').read_text())
    keys = {node.name: {item.target.id for item in node.body if isinstance(item, ast.AnnAssign)}
            for node in stubs.body if isinstance(node, ast.ClassDef)}
    world = engine.World()
    world.add_body('nut', shape=engine.Box((0.1, 0.1, 0.1)), mass=1.0)
    world.add_joint('screw', type='screw', body_b='nut', pitch=0.1)
    dynamics = world.robot_dynamics('nut')
    assert keys['RobotCoordinate'] == set(dynamics.coordinates[0])
    assert keys['RobotFollower'] == set(dynamics.followers[0])
    assert keys['PointMotion'] == set(dynamics.motion_of('nut'))
    assert keys['Linearization'] == set(dynamics.linearize([0.0]))


def test_manual_of_robot_dynamics(tmp_path):
    """Every Python block of docs/robot_dynamics.md runs, all in one process in order."""
    blocks = (SOURCES / 'docs/robot_dynamics.md').read_text().split('```python\n')[1:]
    assert blocks
    script = tmp_path / 'manual.py'
    script.write_text(f'import sys; sys.path[:0] = {sys.path!r}\n' + '\n'.join(b.split('```')[0] for b in blocks))
    subprocess.run([sys.executable, script], check=True, cwd=pathlib.Path(SOURCES), stdout=subprocess.DEVNULL)
