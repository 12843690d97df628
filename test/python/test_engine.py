"""The Python module of the engine, against the runner and closed forms."""
import ast
import concurrent.futures
import copy
import gc
import inspect
import itertools
import json
import math
import pathlib
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import yaml

from constraint_sim import engine
from support import RUNNER, SCENES, SOURCES, run_example

PENDULUM = SCENES / 'pendulum.yaml'


def hanging(**options):
    """Returns a bob of 1 kg on a rod of 1 m, released at 0.1 rad."""
    world = engine.World(**options)
    world.add_body('bob', shape=engine.Sphere(0.1), mass=1.0,
                   position=(math.sin(0.1), 0.0, -math.cos(0.1)))
    world.add_joint('rod', body_b='bob', length=1.0)
    return world


def test_same_bits_as_the_runner(tmp_path):
    """Compares for every scene of the repository the state hash, states and sums of the JSON report."""
    scenes = sorted(SCENES.glob('*.yaml'))
    assert len(scenes) >= 11
    for scene in scenes:
        report = tmp_path / 'report.json'
        subprocess.run([RUNNER, scene, '--duration', '0.5', '--report', report], check=True,
                       stdout=subprocess.DEVNULL)
        expected = json.loads(report.read_text())
        world = engine.load_scene_file(str(scene))
        run = world.run(0.5)
        assert f'0x{world.state_hash:016x}' == expected['state_hash'], scene.name
        assert run.steps == expected['steps'] and world.time == expected['sim_time']
        for name in ('max_constraint_error', 'max_closing_error', 'accumulated_local_error', 'energy_initial',
                     'energy_final'):
            assert getattr(run, name) == expected[name], (scene.name, name)
        assert run.methods == set(expected['methods'])
        for name, state in expected['bodies'].items():
            assert {key: tuple(value) for key, value in state.items()} == world.state(name)


def test_single_steps_are_those_of_a_run():
    stepped, run = hanging(), hanging()
    reports = [stepped.step() for _ in range(100)]
    run.run(1.0)
    assert stepped.state_hash == run.state_hash
    assert [report.step for report in reports] == list(range(1, 101)), 'reports are copies'
    assert run.report.time == run.time == pytest.approx(1.0, abs=1e-12)


def test_pendulum_against_the_elliptic_period():
    """Amplitude 0.1 rad: period 2 pi sqrt(l/g) / agm(1, cos(angle / 2)), after Gauss. The ball does not rotate:
    the rod holds its centre."""
    a, b = 1.0, math.cos(0.05)
    while abs(a - b) > 1e-16:
        a, b = (a + b) / 2.0, math.sqrt(a * b)
    period = 2.0 * math.pi * math.sqrt(1.0 / 9.81) / a
    world = hanging(time_step=period / 100.0, tolerance=1e-10)
    world.run(period)
    # 1e-10 m of error per second of simulated time, over 2 s, and rounding of the period
    assert world.positions[0] == pytest.approx((math.sin(0.1), 0.0, -math.cos(0.1)), abs=1e-9)


def test_verify():
    """verify() accepts a pendulum, also from the text of a scene, and rejects impulses at a long tick; the world
    stays unchanged."""
    world = hanging()
    world.run(0.5)
    before = world.state_hash
    verified = world.verify(1.0)
    assert world.state_hash == before
    assert verified.ticks == 100 and not verified.exceeds and verified.failure == ''
    assert (verified.method, verified.other_method) == ('auto', 'energy_momentum')
    bob = verified.bodies['bob']
    assert bob['verdict'] == 'holds' and bob['exceeded'] is None and bob['chaotic_from'] is None
    assert bob['half_step'] < 1e-10 and bob['growth'] >= 1.0
    assert bob['global_error'] == bob['estimate'] * bob['growth']
    assert 'holds' in str(verified)

    verified = engine.verify(hanging().save_scene(), 1.0, least=1e-5)
    assert not verified.exceeds

    verified = hanging(method='sequential_impulses', time_step=0.1).verify(1.0)
    bob = verified.bodies['bob']
    assert verified.exceeds and bob['verdict'] == 'exceeds' and bob['estimate'] is None
    assert bob['exceeded']['half_step'] > 1e-4 and 'sequential_impulses' in bob['no_estimate']
    for arguments in ({'perturbation': 0.0}, {'least': -1.0}, {'margin': 0.5}):
        with pytest.raises(ValueError, match=next(iter(arguments))):
            hanging().verify(1.0, **arguments)
    with pytest.raises(ValueError, match='duration'):
        hanging().verify(-1.0)
    with pytest.raises(TypeError, match='colour'):
        hanging().verify(1.0, colour='red')


def test_arrays_are_views_that_follow():
    world = hanging()
    states, positions = world.states, world.positions
    assert states.shape == (1, 13) and np.shares_memory(states, positions)
    assert np.shares_memory(positions, world.positions), 'asked again, the same memory'
    world.run(0.5)
    expected = world.state('bob')
    assert tuple(positions[0]) == expected['position']
    assert tuple(states[0, 3:7]) == expected['orientation'] == tuple(world.orientations[0])
    assert tuple(states[0, 7:10]) == expected['linear_velocity']
    assert tuple(states[0, 10:]) == expected['angular_velocity']
    with pytest.raises(ValueError):
        positions[0, 0] = 1.0
    world.set_state('bob', position=(0.0, 1.0, 0.0))
    assert tuple(positions[0]) == (0.0, 1.0, 0.0)


def test_arrays_outlive_edits_and_the_world():
    world = hanging()
    positions = world.positions
    before = positions.copy()
    world.add_body('other', mass=1.0)
    world.run(0.1)
    assert (positions == before).all(), 'the last state before bodies changed'
    assert world.positions.shape == (2, 3)
    kept = world.positions
    expected = kept.copy()
    del world
    gc.collect()
    assert (kept == expected).all()


def test_samples():
    world, again = hanging(), hanging()
    samples = world.run(1.0, every=25)
    assert samples.times == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0], abs=1e-12)
    for index in range(1, 5):
        again.run(0.25)
        assert (samples.states[index] == again.states).all()
    assert world.run(0.1).states is None


def test_bodies_joints_and_options_go_round():
    world = engine.World(method='energy_momentum', gravity=(0.0, 0.0, -1.62), threads=2)
    world.add_body('floor', type='static', shape=engine.Plane(), friction=0.3)
    world.add_body('box', shape=engine.Box((1.0, 2.0, 3.0)), mass=2.0, position=(0.0, 0.0, 5.0),
                   orientation=(0.0, 0.0, 0.6, 0.8), restitution=0.5, gravity_compensation=0.25,
                   collision_groups=6, collision_mask=0x80000001)
    world.add_body('point', mass=1.0, position=(2.0, 0.0, 5.0), inertia=(0.1, 0.1, 0.1))
    world.add_body('can', shape=engine.Cylinder(0.2, 0.5), mass=6.0, position=(0.0, 9.0, 5.0))
    can = world.body('can')
    assert (can['shape'].radius, can['shape'].length) == (0.2, 0.5)
    assert repr(can['shape']) == 'Cylinder(0.2, 0.5)'
    world.add_body('pill', shape=engine.Capsule(0.2, 0.5), mass=6.0, position=(0.0, 19.0, 5.0))
    pill = world.body('pill')
    assert (pill['shape'].radius, pill['shape'].length) == (0.2, 0.5)
    assert repr(pill['shape']) == 'Capsule(0.2, 0.5)'
    world.add_body('table', mass=3.0, inertia=(1.0, 1.0, 1.0), position=(0.0, 29.0, 5.0),
                   shape=engine.Compound([engine.Box((1.0, 1.0, 0.1)),
                                          (engine.Sphere(0.1), {'position': (0.0, 0.0, -0.5)},
                                           {'friction': 0.5})]))
    table = world.body('table')
    assert repr(table['shape']) == 'Compound(2 shapes)'
    (top, _, plain), (foot, pose, surface) = table['shape'].shapes
    assert (top.size, foot.radius, pose['position']) == ((1.0, 1.0, 0.1), 0.1, (0.0, 0.0, -0.5))
    assert (plain, surface) == ({}, {'friction': 0.5})
    with pytest.raises(ValueError, match=r'shapes\[0\].*friction'):
        engine.Compound([(engine.Sphere(0.1), None, {'friction': -1.0})])
    with pytest.raises(TypeError, match=r'roughness'):
        engine.Compound([(engine.Sphere(0.1), None, {'roughness': 1.0})])
    with pytest.raises(ValueError, match=r'shapes\[1\]'):
        engine.Compound([engine.Sphere(0.1), engine.Plane()])
    with pytest.raises(ValueError, match=r'shapes\[0\].*must be a shape'):
        engine.Compound([(engine.Sphere(0.1),)])
    world.remove_body('table')
    world.remove_body('pill')
    world.remove_body('can')
    world.add_body('hammer', shape=engine.Sphere(0.1), mass=1.0, inertia=(0.1, 0.1, 0.1),
                   position=(4.0, 0.0, 5.0),
                   shape_pose={'position': (0.0, 0.0, 0.2), 'orientation': (0.6, 0.0, 0.0, 0.8)})
    assert world.body('hammer')['shape_pose']['position'] == (0.0, 0.0, 0.2)
    assert world.body('box')['shape_pose'] is None
    assert world.body('box')['gravity_compensation'] == 0.25
    assert world.body('box')['collision_groups'] == 6
    assert world.body('box')['collision_mask'] == 0x80000001
    world.add_joint('spring', body_a='box', body_b='point', frequency=2.0, damping_ratio=0.1)
    world.add_joint('hook', type='ball', body_b='box', anchor_a=(0.0, 0.0, 6.5),
                    anchor_b=(0.0, 0.0, 1.5), break_force=1e6)
    world.add_joint('winch', body_a='box', body_b='point', motor={'bias': 0.1})
    again = engine.World(**world.options)
    for name in world.body_names:
        again.add_body(**world.body(name))
    for name in world.joint_names:
        again.add_joint(**world.joint(name))
    assert again.options == world.options and again.state_hash == world.state_hash
    for each in (world, again):
        each.run(0.5)
    assert again.state_hash == world.state_hash
    assert world.joint_state('winch')['travel'] == pytest.approx(0.05, abs=1e-12)
    assert world.remove_body('point') == ['spring', 'winch']
    world.remove_joint('hook')
    assert world.joint_names == []


def test_slack_ropes():
    """A rope with stiffness and a one-sided pulley are made of keywords, and pull or do nothing."""
    world = engine.World(time_step=0.01)
    world.add_body('ball', mass=1.0, position=(0.0, 0.0, -0.5))
    world.add_body('weight', mass=2.0, position=(1.0, 0.0, -1.0))
    world.add_joint('bungee', body_b='ball', length=1.0, stiffness=100.0, one_sided=True)
    world.add_joint('to_ball', free=True, body_b='ball')
    world.add_joint('to_weight', free=True, anchor_a=(1.0, 0.0, 0.0), body_b='weight')
    world.add_joint('hoist', type='pulley', joints=('to_ball', 'to_weight'), value=2.0, one_sided=True)
    assert world.joint('bungee')['one_sided'] is True and world.joint('hoist')['one_sided'] is True
    world.step()
    assert world.joint_state('bungee')['force'] == 0.0 and world.joint_state('hoist')['force'] == 0.0
    world.run(1.0)
    assert world.joint_state('hoist')['force'] <= 1e-9
    again = engine.World(**world.options)
    for name in world.body_names:
        again.add_body(**world.body(name))
    for name in world.joint_names:
        again.add_joint(**world.joint(name))
    assert again.joint('hoist') == world.joint('hoist') and again.joint('bungee') == world.joint('bungee')
    with pytest.raises(ValueError, match='one_sided: only a spring is one-sided'):
        world.add_joint('rod', body_b='ball', one_sided=True)
    with pytest.raises(ValueError, match="ratio: must be > 0 for a one-sided pulley"):
        world.add_joint('push', type='pulley', joints=('to_ball', 'to_weight'), ratio=-1.0, one_sided=True)


def test_joints_with_axes():
    """A hinge rotates about its axis only; axes without direction, or given twice, are rejected."""
    def arm():
        world = engine.World(method='runge_kutta', time_step=0.01)
        world.add_body('arm', shape=engine.Box((1.0, 0.1, 0.1)), mass=1.0, position=(0.5, 0.0, 0.0))
        return world
    hinge = {'type': 'hinge', 'body_b': 'arm', 'anchor_b': (-0.5, 0.0, 0.0)}
    world = arm()
    world.add_joint('hinge', axis_a=(0.0, 1e-200, 0.0), axis_b=(0.0, 3.0, 0.0), **hinge)
    world.run(0.5)
    assert world.joint_state('hinge')['error'] == pytest.approx(0.0, abs=1e-14)
    assert world.positions[0, 1] == pytest.approx(0.0, abs=1e-14)
    assert world.positions[0, 2] < -0.3
    again = arm()
    again.add_joint(**world.joint('hinge'))
    again.run(0.5)
    assert again.state_hash == world.state_hash
    frame = (0.0, 0.0, 0.0, 1.0)
    for wrong, why in (({'axis_a': (0.0, 0.0, 0.0)}, 'axis_a: must not be'),
                       ({'axis_b': (0.0, 0.0, 0.0)}, 'axis_b: must not be'),
                       ({'axis_a': (math.nan, 0.0, 1.0)}, 'axis_a: must be finite'),
                       ({'axis_a': (0.0, 0.0, 1.0), 'frame_a': frame}, 'axis_a: give this or'),
                       ({'axis_b': (0.0, 0.0, 1.0), 'frame_b': frame}, 'axis_b: give this or'),
                       ({'frame_b': (0.0, 0.0, 0.0, 0.0)}, 'frame_b: must be a unit')):
        with pytest.raises(ValueError, match=why):
            arm().add_joint('hinge', **hinge, **wrong)


def bar(method='runge_kutta', gravity=0.0):
    """Returns a bar of 2 kg and 1 m along x, from the origin on; its moment about the end is BAR_INERTIA."""
    world = engine.World(method=method, time_step=0.01, gravity=(0.0, 0.0, -gravity))
    world.add_body('bar', shape=engine.Box((1.0, 0.1, 0.1)), mass=2.0, position=(0.5, 0.0, 0.0))
    return world


BAR_END = {'body_b': 'bar', 'anchor_b': (-0.5, 0.0, 0.0)}
BAR_INERTIA = 2.0 * 1.01 / 12.0 + 2.0 * 0.25


def test_laws_of_coordinates():
    world = bar()
    world.add_joint('door', type='hinge', motor={'bias': 0.5}, **BAR_END)
    world.run(1.0)
    door = world.joint_state('door')
    assert door['coordinates'][0] == {'position': pytest.approx(0.5, abs=1e-12), 'bias': 0.5,
                                      'velocity': pytest.approx(0.5, abs=1e-12),
                                      'effort': pytest.approx(0.0, abs=1e-12)}
    assert door['reached_rate'] == door['coordinates'][0]['velocity']
    world.set_motor('door', force=BAR_INERTIA * 2.0)  # [rad/s^2] times the moment
    world.run(1.0)
    # 0.5 + 0.5 t + t^2 at t = 1, within the substeps' tolerance of 1e-8 m/s
    assert world.joint_state('door')['coordinates'][0]['position'] == pytest.approx(2.0, abs=1e-7)
    world.set_motor('door', removed=True)
    assert world.joint('door')['coordinates'][0]['motor'] is None
    world.run(0.1)
    assert world.joint_state('door')['coordinates'][0]['velocity'] == pytest.approx(2.5, abs=1e-7)


def test_springs_go_by_frequency_and_joints_go_round():
    laws = {'frequency': 2.0, 'damping_ratio': 0.1, 'rest': 0.3, 'position': 0.1, 'lower': -1.0,
            'upper': 1.0, 'limit_restitution': 0.5, 'friction': 0.01}
    world = bar('auto')
    world.add_joint('door', type='hinge', break_torque=1e3, **laws, **BAR_END)
    law, = world.joint('door')['coordinates']
    omega = 2.0 * math.pi * 2.0
    # one sum and one division of doubles
    assert law['stiffness'] == pytest.approx(BAR_INERTIA * omega ** 2, rel=1e-13)
    assert law['damping'] == pytest.approx(0.2 * BAR_INERTIA * omega, rel=1e-13)
    assert (law['zero'], law['frequency'], law['position']) == (0.1, 0.0, None)
    again, listed = bar('auto'), bar('auto')
    again.add_joint(**world.joint('door'))
    listed.add_joint('door', type='hinge', break_torque=1e3, coordinates=[laws], **BAR_END)
    for each in (world, again, listed):
        each.run(0.5)
        assert each.state_hash == world.state_hash


def test_further_coordinates_have_numbers():
    world = bar()
    rod = {'type': 'cylindrical', 'body_b': 'bar'}
    world.add_joint('rod', coordinates=[{}, {'motor': {'bias': -0.5}}], **rod)
    world.set_motor('rod', coordinate=0, bias=0.2)
    world.run(1.0)
    # exact in time, each to rounding
    assert [c['position'] for c in world.joint_state('rod')['coordinates']] == \
        pytest.approx([0.2, -0.5], abs=1e-12)
    for wrong, why in (({'coordinates': [{}, {}, {}]}, 'coordinates: a cylindrical joint has 2'),
                       ({'coordinates': [{}], 'rest': 1.0}, 'coordinates: give these or'),
                       ({'coordinates': 'ab'}, 'coordinates: must be a list'),
                       ({'coordinates': [3]}, 'coordinates: must be a dict, got 3'),
                       ({'lower': 2.0, 'upper': 1.0}, 'upper: must be above lower'),
                       ({'motor': {'force': 1.0, 'bias': 1.0}}, 'motor.force: ')):
        with pytest.raises(ValueError, match=why):
            bar().add_joint('rod', **rod, **wrong)
    with pytest.raises(TypeError, match="no argument 'stifness'"):
        bar().add_joint('rod', coordinates=[{'stifness': 1.0}], **rod)
    with pytest.raises(ValueError, match='no coordinate 2'):
        world.set_motor('rod', coordinate=2, bias=1.0)
    with pytest.raises(ValueError, match='removed: '):
        world.set_motor('rod', removed=True, bias=1.0)


def test_lengths_have_velocity_motors_alone():
    world = hanging()
    assert list(world.joint('rod')['motor']) == ['bias', 'amplitude', 'frequency', 'phase', 'max_force', 'timeout']
    for key in ('position', 'force', 'servo_frequency', 'servo_damping_ratio', 'servo_stiffness', 'servo_damping'):
        with pytest.raises(TypeError, match=f"no argument '{key}'"):
            world.set_motor('rod', **{key: 1.0})
        with pytest.raises(TypeError, match=f"no argument '{key}'"):
            world.set_joint('rod', motor={key: 1.0})
        with pytest.raises(TypeError, match=f"no argument '{key}'"):
            world.add_joint('other', body_b='bob', motor={key: 1.0})


def test_joints_change_while_they_act():
    world = engine.World(gravity=(0, 0, 0))
    world.add_body('bob', mass=2.0, position=(1, 0, 0))
    world.add_joint('rod', body_b='bob')
    assert world.set_joint('rod', length=1.5) == 'length 0.5 m off; closes in 0.5 s'
    world.run(0.6)
    assert world.state('bob')['position'][0] == pytest.approx(1.5, abs=1e-12)
    assert world.set_enabled('rod', False) == ''
    assert world.joint('rod')['enabled'] is False
    world.set_state('bob', position=(1.75, 0, 0))
    assert world.set_enabled('rod', True) == 'length 0.25 m off; closes in 0.5 s'
    with pytest.raises(ValueError, match='length'):
        world.set_joint('rod', length=-1.0)
    with pytest.raises(TypeError, match='coordinate'):
        world.set_joint('rod', coordinate=1)


def test_the_wrench_of_a_joint_and_how_far_it_is_open():
    world = bar(gravity=9.81)
    world.add_joint('glue', type='weld', **BAR_END)
    assert world.opening('glue') == ''
    world.run(0.1)
    wrench = world.joint_wrench('glue')
    weight = 2.0 * 9.81
    assert wrench['force'] == pytest.approx((0.0, 0.0, weight), abs=1e-9)
    assert wrench['torque'] == pytest.approx((0.0, -0.5 * weight, 0.0), abs=1e-9)
    world = bar()
    world.add_joint('glue', type='weld', anchor_a=(0.0, 0.25, 0.0), **BAR_END)
    assert world.opening('glue') == 'anchors 0.25 m apart; closes in 0.5 s'


def test_motors_wrenches_and_broken_joints():
    world = hanging()
    world.set_motor('rod', bias=0.2)
    world.run(1.0)
    # the motor adds exactly bias * time; the rod keeps it to rounding
    assert np.linalg.norm(world.positions[0]) == pytest.approx(1.2, abs=1e-9)
    world.set_broken('rod', True)
    assert world.joint_state('rod')['broken']
    free = engine.World(gravity=(0.0, 0.0, 0.0))
    free.add_body('puck', mass=2.0)
    free.add_wrench('puck', force=(4.0, 0.0, 0.0), duration=0.5)
    free.run(1.0)
    # impulse 2 N s on 2 kg from rest: 1 m/s, and 0.25 + 0.5 m
    assert free.linear_velocities[0] == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    assert free.positions[0] == pytest.approx((0.75, 0.0, 0.0), abs=1e-9)
    free.add_wrench('puck', force=(1.0, 0.0, 0.0))
    free.clear_wrenches('puck')
    free.run(1.0)
    assert free.linear_velocities[0, 0] == pytest.approx(1.0, abs=1e-12)


def test_snapshots():
    world = hanging()
    world.run(0.3)
    positions = world.positions
    snapshot, copied, deep = world.copy(), copy.copy(world), copy.deepcopy(world)
    hash_then = world.state_hash
    world.run(0.7)
    after = world.state_hash
    assert snapshot.state_hash == copied.state_hash == deep.state_hash == hash_then != after
    snapshot.run(0.7)
    assert snapshot.state_hash == after
    world.restore(copied)
    assert world.state_hash == hash_then and tuple(positions[0]) == copied.state('bob')['position']
    world.reset()
    world.set_time(0.0, 0)
    assert world.state_hash == hanging().state_hash


def test_scenes_as_text_and_file(tmp_path):
    world = engine.load_scene_file(str(PENDULUM))
    assert world.save_scene() == engine.load_scene(world.save_scene()).save_scene()
    path = tmp_path / 'saved.yaml'
    world.save_scene_file(str(path))
    assert path.read_text() == world.save_scene()
    assert engine.load_scene('bodies: []', time_step=0.25).options['time_step'] == 0.25
    with pytest.raises(ValueError, match='path: cannot use'):
        world.save_scene_file(str(tmp_path / 'missing' / 'x.yaml'))


def test_plan_and_reports():
    world = engine.load_scene_file(str(SCENES / 'two_boxes.yaml'))
    run = world.run(0.2)
    assert 'islands:' in world.explain()
    assert any(line.startswith('springs:') for line in world.left_out())
    assert sum(island['bodies'] for island in world.islands()) == 2
    report = world.report
    assert set(report.islands) == set(engine.METHODS) - {'auto'}
    assert report.energy == world.energy == run.energy_final
    hanging_world = hanging()
    step = hanging_world.step()
    assert step.islands['runge_kutta'] == 1 and not step.failed and step.substeps >= 1
    dropped = engine.World()
    dropped.add_body('floor', type='static', shape=engine.Plane())
    dropped.add_body('ball', shape=engine.Sphere(0.5), mass=1.0, position=(0, 0, 0.5))
    dropped.run(0.3)
    contact, = dropped.contacts()
    assert {contact['body_a'], contact['body_b']} == {'floor', 'ball'}
    assert contact['normal_force'] == pytest.approx(9.81, rel=0.05)  # at rest it carries the weight
    on_ball = 1.0 if contact['body_a'] == 'ball' else -1.0
    assert on_ball * contact['force'][2] == pytest.approx(contact['normal_force'])
    assert contact['state'] == 'closed'  # without friction


def test_events_of_the_last_step():
    """A ball falls by 1 m onto a floor, e = 0, beside a bob whose rod breaks at half of 3 m g."""
    world = engine.World(time_step=1 / 60, tolerance=1e-10)
    world.add_body('floor', type='static', shape=engine.Plane())
    world.add_body('ball', shape=engine.Sphere(0.1), mass=2.0, position=(0, 0, 1.1))
    world.add_body('bob', mass=1.0, position=(5, 0, 8))
    world.add_joint('rod', anchor_a=(4, 0, 8), body_b='bob', break_force=1.5 * 9.81)
    assert world.events() == []
    told = {}
    for _ in range(60):
        world.step()
        told.update({event['kind']: event for event in world.events()})
    assert set(told) == {'contact_began', 'broken'}
    hit, broken = told['contact_began'], told['broken']
    fall = (2 / 9.81) ** 0.5  # rounding of the time and of the impulse
    assert hit['time'] == pytest.approx(fall, abs=1e-12)
    assert hit['impulse'] == pytest.approx(2.0 * 9.81 * fall, abs=1e-11)
    assert {hit['body_a'], hit['body_b']} == {'floor', 'ball'}
    assert hit['joint'] is None and hit['coordinate'] is None
    assert (broken['joint'], broken['body_a'], broken['body_b']) == ('rod', 'world', 'bob')
    assert broken['coordinate'] is None and broken['impulse'] == 0.0
    assert 0.0 < broken['time'] < 1.0 and world.joint_state('rod')['broken']


def test_failed_physics_is_reported_not_raised():
    # 1e20 m is the bound: six ticks of 1e16 m stay below it, the seventh does not
    world = engine.World(gravity=(0.0, 0.0, 0.0))
    world.add_body('slow', mass=1.0)
    world.add_body('fast', mass=1.0, position=(9.9935e19, 0, 0), linear_velocity=(1e18, 0, 0))
    run = world.run(10.0, every=1)
    last, report = world.state_hash, world.report
    assert run.failed and report.failed and not report.stopped
    assert run.failure == report.failure == 'a body is beyond 1e20 m, m/s or rad/s'
    assert run.failed_body == report.failed_body == 'fast'
    assert run.steps == world.step_count == 6 and len(run.times) == 7
    assert np.isfinite(run.states).all() and world.positions[1, 0] <= 1e20
    assert world.step().failed and world.state_hash == last, 'the world keeps the last good state'
    world.remove_body('fast')
    assert world.report.failed_body is None, 'it has no such body any more'
    good = world.step()
    assert not good.failed and good.failure == '' and good.failed_body is None
    lost = engine.World()
    lost.set_time(2.0 ** 46 - 0.05, 0)
    run = lost.run(10.0)
    assert run.failure == 'a tick is lost beside so long a time, or leads beyond 1e20 s' and run.failed_body is None


def test_what_impulses_report():
    """Compares the work of a force with the energy that it gives, and sums and maxima of a run with its steps."""
    world = engine.World(method='sequential_impulses', gravity=(0.0, 0.0, 0.0))
    world.add_body('puck', mass=1.0)
    world.add_wrench('puck', force=(2.0, 0.0, 0.0))
    run = world.run(1.0)
    # impulses act before the motion of their tick: a hundredth more distance than 1 m; sums of 100 terms
    assert run.driven_work == pytest.approx(2.0 * world.positions[0, 0], abs=1e-12)
    assert run.driven_work == pytest.approx(2.02, abs=1e-12)
    assert run.energy_final == pytest.approx(2.0, abs=1e-12)  # (2 N s)^2 / 2 kg
    assert run.correction_work == run.solver_residual == 0.0
    chain = engine.load_scene_file(str(SCENES / 'chain_heavy_end.yaml'))
    chain.set_options(method='sequential_impulses')
    again = chain.copy()
    reports = [chain.step() for _ in range(50)]
    run = again.run(50 * again.options['time_step'])
    assert again.state_hash == chain.state_hash
    assert run.solver_residual == max(report.solver_residual for report in reports) > 0.0
    assert run.correction_work == sum(report.correction_work for report in reports) != 0.0
    assert run.driven_work == sum(report.driven_work for report in reports)
    assert run.energy_rise == max(report.energy_rise for report in reports)
    assert len(run.unclosed_joints) >= max(report.unclosed_joints for report in reports)
    last = reports[-1]
    assert last.worst_joint in chain.joint_names
    assert abs(chain.joint_state(last.worst_joint)['error']) == last.max_constraint_error
    chain.remove_joint(last.worst_joint)
    assert last.worst_joint is not None and chain.report.worst_joint is None


def test_doubtful_settings():
    world = hanging()
    assert world.doubtful_settings() == []
    world.add_body('odd', mass=1.0, inertia=(1.0, 2.0, 4.0))
    assert world.doubtful_settings() == ["body 'odd': inertia (1, 2, 4) is that of no distribution of mass: its "
                                'largest exceeds the sum of the others']


def rejected(call, *arguments, **keywords):
    world = hanging()
    before = world.state_hash
    with pytest.raises(ValueError) as error:
        getattr(world, call)(*arguments, **keywords)
    assert world.state_hash == before, 'nothing is half applied'
    return str(error.value)


def test_bad_input_names_field_and_value():
    assert rejected('add_body', 'x', mass='heavy') == "mass: must be a number, got 'heavy'"
    assert rejected('add_body', 'x', mass=True) == 'mass: must be a number, got True'
    assert rejected('add_body', 'x', mass=-1.0) == 'mass: must be a finite number > 0, got -1'
    assert rejected('add_body', 'x', mass=1.0, position=(1, 2)) == \
        'position: must be 3 numbers, got (1, 2)'
    assert rejected('add_body', 'x', mass=1.0, position=(1, 2, None)) == \
        'position: must be a number, got None'
    assert rejected('add_body', 'x', mass=1.0, position='abc') == \
        "position: must be 3 numbers, got 'abc'"
    assert rejected('add_body', 'x', mass=1.0, shape='box').startswith('shape: must be a Point,')
    assert rejected('add_body', 'x', type='liquid').startswith("type: there is no 'liquid'")
    assert 'bob' in rejected('add_body', 'bob', mass=1.0)
    assert rejected('add_body', 'x', mass=1.0, no_collision=1) == \
        'no_collision: must be True or False, got 1'
    assert rejected('add_body', 'x', mass=1.0, collision_groups=0) == \
        'collision_groups: must be from 1 to 4294967295, got 0'
    assert rejected('add_body', 'x', mass=1.0, collision_mask=-1) == \
        'collision_mask: must be a whole number of 32 bits, got -1'
    assert rejected('add_body', 'x', mass=1.0, collision_mask=1.5) == \
        'collision_mask: must be a whole number, got 1.5'
    assert rejected('add_body', 'x', mass=1.0, shape_pose=3) == \
        'shape_pose: must be a dict of position and orientation, got 3'
    assert rejected('add_body', 'x', mass=1.0, shape_pose={}) == \
        'shape_pose: only a sphere, a box, a cylinder, a capsule or a hull has one'
    assert rejected('add_joint', 'j', type='cog').startswith("type: there is no 'cog'")
    assert "'nobody'" in rejected('add_joint', 'j', body_b='nobody')
    assert rejected('add_joint', 'j', body_b='bob', motor=3) == 'motor: must be a dict, got 3'
    assert 'timeout' in rejected('set_motor', 'rod', timeout=-1.0)
    assert "'none'" in rejected('set_motor', 'none', bias=1.0)
    assert rejected('set_options', order=8.5) == 'order: must be a whole number, got 8.5'
    assert rejected('set_options', order=2 ** 40).endswith(f'got {2 ** 40}')
    assert rejected('set_options', method='magic').startswith("method: there is no 'magic'")
    assert 'tolerance' in rejected('set_options', tolerance=math.nan)
    assert rejected('run', -1.0).endswith('got -1.0')
    assert rejected('run', math.inf).endswith('got inf')
    assert rejected('run', 1.0, every=-1).endswith('got -1')
    assert rejected('run', 1.0, time_limit=0.0).endswith('got 0.0')
    assert 'force' in rejected('add_wrench', 'bob', force=(math.nan, 0, 0))
    for call, error in ((lambda: engine.Box((1, 2)), 'size: must be 3 numbers, got (1, 2)'),
                        (lambda: engine.Sphere('r'), "radius: must be a number, got 'r'"),
                        (lambda: engine.Hull(itertools.repeat((0, 0, 0))),
                         'vertices: must be at most 100000, got 100001'),
                        (lambda: engine.load_scene('bodies: 3', 'mine.yaml'),
                         "mine.yaml:1: bodies: expected a list, got '3'"),
                        (lambda: engine.load_scene_file('/missing.yaml'),
                         '/missing.yaml: cannot read this file: No such file or directory')):
        with pytest.raises(ValueError) as caught:
            call()
        assert str(caught.value) == error
    assert issubclass(engine.SceneError, ValueError)
    with pytest.raises(TypeError, match="has no argument 'mas'; there are .*mass"):
        hanging().add_body('x', mas=1.0)


def test_worlds_on_threads_without_the_gil():
    """While one world runs, this thread continues; eight worlds at once have the bits of one."""
    expected = hanging()
    expected.run(20.0)
    worlds = [hanging() for _ in range(8)]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda world: world.run(20.0), worlds))
    assert {world.state_hash for world in worlds} == {expected.state_hash}

    for limit in (0.5, 4.0, 16.0):  # the longer ones for a busy machine
        slow = hanging(time_step=1e-4)
        thread = threading.Thread(target=slow.run, args=(1e4,), kwargs={'time_limit': limit})
        thread.start()
        turns, refused = 0, ''
        while thread.is_alive():
            turns += 1
            try:
                slow.state('bob')
            except RuntimeError as error:
                refused = str(error)
            time.sleep(0.01)
        if turns >= 5:
            break
    # with the GIL held the loop would run once or twice; 50 runs take 0.5 s, far fewer are enough
    assert turns >= 5
    assert refused == 'world: another thread is stepping it'
    slow.state('bob')


def in_a_process(script, timeout=60):
    """Returns the output of a script that has the module as `engine`; it has to end within the timeout [s]."""
    start = f'import sys; sys.path[:0] = {sys.path!r}\nfrom constraint_sim import engine\n'
    run = subprocess.run([sys.executable, '-c', start + script], capture_output=True, text=True, timeout=timeout)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_arrays_on_two_threads_at_once():
    """Makes the first arrays of a process on threads that start together."""
    script = ('import threading\n'
              'worlds = [engine.World() for _ in range(8)]\n'
              'for world in worlds: world.add_body("a", mass=1.0)\n'
              'barrier = threading.Barrier(8)\n'
              'def ask(world):\n'
              '    barrier.wait()\n'
              '    world.positions\n'
              'threads = [threading.Thread(target=ask, args=(world,)) for world in worlds]\n'
              'for thread in threads: thread.start()\n'
              'for thread in threads: thread.join()\n'
              'print("done")\n')
    for _ in range(3):
        assert in_a_process(script) == 'done\n'
    assert in_a_process('print("numpy" in sys.modules)\n') == 'True\n'


def test_arguments_that_change_while_they_are_read():
    """Passes a list that its own element shortens, and one without end."""
    script = ('import itertools\n'
              'class Number:\n'
              '    def __init__(self, action): self.action = action\n'
              '    def __float__(self):\n'
              '        self.action()\n'
              '        return 1.0\n'
              'world = engine.World()\n'
              'world.add_body("a", mass=1.0)\n'
              'for _ in range(100):\n'
              '    numbers = []\n'
              '    numbers[:] = [Number(numbers.clear), [object()] * 1000, [object()] * 1000]\n'
              '    try: world.set_state("a", position=numbers)\n'
              '    except ValueError: pass\n'
              '    numbers[:] = [Number(numbers.clear), 2.0, 3.0]\n'
              '    world.set_state("a", position=numbers)\n'
              '    assert world.state("a")["position"] == (1.0, 2.0, 3.0)\n'
              'try: world.set_state("a", position=itertools.count())\n'
              'except ValueError as error: print(error)\n'
              '# an argument that removes the body it is for\n'
              'try: world.set_state("a", position=(Number(lambda: world.remove_body("a")), 2.0, 3.0))\n'
              'except ValueError as error: print(error)\n'
              'world.add_body("a", shape=engine.Sphere(0.1), mass=1.0)\n'
              'world.add_joint("j", body_b="a", type="hinge")\n'
              'try: world.set_joint("j", damping=Number(lambda: world.remove_joint("j")))\n'
              'except ValueError as error: print(error)\n'
              'print(world.joint_names, world.body_names)\n')
    assert in_a_process(script).splitlines() == [
        'position: must be 3 numbers, got count(34)', "body: there is none named 'a'",
        "constraint: there is none named 'j'", "[] ['a']"]


def test_arguments_are_read_before_the_world_is_looked_at():
    """Arguments let another thread step the world: no call then accesses a world during a step."""
    script = ('import threading, time\n'
              'world = engine.World(time_step=1e-4)\n'
              'for i in range(50): world.add_body(f"b{i}", mass=1.0, position=(i, 0, 0))\n'
              'for i in range(49): world.add_joint(f"j{i}", body_a=f"b{i}", body_b=f"b{i + 1}")\n'
              'class Number:\n'
              '    def __float__(self):\n'
              '        time.sleep(0.001)\n'
              '        return 1.0\n'
              'ends = time.monotonic() + 3.0\n'
              'answers = set()\n'
              'def step():\n'
              '    while time.monotonic() < ends:\n'
              '        world.run(0.002)\n'
              'def edit():\n'
              '    while time.monotonic() < ends:\n'
              '        for call in (lambda: world.set_state("b3", position=(Number(), 0.0, 0.0)),\n'
              '                     lambda: world.add_wrench("b4", force=(Number(), 0, 0), duration=0.01),\n'
              '                     lambda: world.set_motor("j5", bias=Number()),\n'
              '                     lambda: world.set_joint("j6", break_force=Number()),\n'
              '                     lambda: world.set_options(tolerance=Number())):\n'
              '            try:\n'
              '                call()\n'
              '                answers.add("done")\n'
              '            except RuntimeError as error:\n'
              '                answers.add(str(error))\n'
              'positions = world.positions\n'
              'threads = [threading.Thread(target=step), threading.Thread(target=edit)]\n'
              'for thread in threads: thread.start()\n'
              'for thread in threads: thread.join()\n'
              'print(sorted(answers))\n')
    answers = ast.literal_eval(in_a_process(script))
    assert set(answers) <= {'done', 'world: another thread is stepping it'} and answers


@pytest.mark.parametrize('name', ['World', 'Point', 'Sphere', 'Box', 'Plane', 'Cylinder', 'Capsule', 'StepReport', 'RunReport'])
def test_no_object_without_init(name):
    script = (f'kind = engine.{name}\n'
              'try: print(kind.__new__(kind).__repr__())\n'
              'except TypeError as error: print("TypeError")\n'
              'class Own(kind): pass\n'
              'try: print(Own.__new__(Own).__repr__())\n'
              'except TypeError as error: print("TypeError")\n')
    assert in_a_process(script) == 'TypeError\nTypeError\n'


def test_classes_of_ones_own():
    class Own(engine.World):
        def __init__(self, length):
            super().__init__(gravity=(0, 0, 0))
            self.length = length

    world = Own(2.0)
    assert world.options['gravity'] == (0.0, 0.0, 0.0) and world.length == 2.0
    assert isinstance(copy.copy(world), engine.World)


def test_a_saved_scene_replaces_the_old_one_as_a_whole(tmp_path):
    """A file of more than 1 KiB cannot be made here, as on a full disk."""
    path = tmp_path / 'saved.yaml'
    path.write_text('old')
    script = ('import resource, signal\n'
              'signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n'
              'resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))\n'
              'world = engine.World()\n'
              'for i in range(100): world.add_body(f"b{i}", mass=1.0)\n'
              f'try: world.save_scene_file({str(path)!r})\n'
              'except ValueError as error: print(error)\n')
    assert in_a_process(script) == f"path: cannot write '{path}': File too large\n"
    assert path.read_text() == 'old' and list(tmp_path.iterdir()) == [path]
    hanging().save_scene_file(str(path))
    assert path.read_text() == hanging().save_scene()
    with pytest.raises(ValueError, match='zero byte'):
        hanging().save_scene_file(str(path) + '\0.txt')
    with pytest.raises(ValueError, match='zero byte'):
        engine.load_scene_file(str(path) + '\0.txt')


def test_time_limit_and_interrupt():
    world = hanging(time_step=1e-4)
    run = world.run(1e4, time_limit=0.05)
    assert run.timed_out and 0 < run.steps < 10 ** 8 and not run.failed
    script = (f'import sys; sys.path[:0] = {sys.path!r}\n'
              'from constraint_sim import engine\n'
              'world = engine.World(time_step=1e-6)\n'
              'world.add_body("a", mass=1.0)\n'
              'positions = world.positions\n'
              'try:\n    print("running", flush=True)\n    world.run(1e6)\n'
              'except KeyboardInterrupt:\n'
              '    assert tuple(positions[0]) == world.state("a")["position"]\n'
              '    world.step()\n    print("interrupted")\n')
    process = subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == 'running\n'
    time.sleep(0.2)  # until it runs, which is not reported; before that it ends in the same way
    process.send_signal(2)
    assert process.communicate(timeout=120)[0] == 'interrupted\n'
    assert process.returncode == 0


def test_robots_of_urdfs():
    """The shipped arm holds its pose for 1 s by the YAML beside it; what deviates is named."""
    world = engine.World(time_step=0.01)
    robot = world.add_urdf_file(str(SOURCES / 'config/robots/arm.urdf'), prefix='left/', position=(0, 2, 0), fixed=True)
    assert robot['name'] == 'arm' and 'left/base_link/com' in robot['bodies']
    assert robot['links']['left/tool0']['body'] in robot['bodies']
    first = {name: world.joint_state(name)['coordinates'][0]['position'] for name in robot['constraints']
             if not name.startswith('left/no_contact')}
    assert 'left/elbow' in first
    world.run(1.0)
    for name, position in first.items():
        assert abs(world.joint_state(name)['coordinates'][0]['position'] - position) < 1e-9  # rounding
    before = world.state_hash
    mass = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    text = ('<robot name="r"><link name="a">' + mass + '</link><link name="tool0"/><joint name="turn" '
            'type="continuous"><parent link="a"/><child link="tool0"/></joint></robot>')
    for bad in ('', '<sdf version="1.6"/>', text.replace('value="2"', 'value="-2"')):
        with pytest.raises(ValueError):
            world.add_urdf(bad)
    assert world.state_hash == before
    robot = world.add_urdf(text, extra='positions: {turn: 0.5}')
    assert robot['fixed_joints'] == {'turn': 0.5}
    assert any("'turn' at 0.5 (link 'tool0')" in warning for warning in robot['warnings'])
    with pytest.raises(ValueError, match="already a body named 'a/com'"):
        world.add_urdf(text)


def test_rays():
    """A ray at the height b above the middle of a ball of radius r hits it √(r² − b²) before the middle."""
    world = engine.World()
    world.add_body('floor', type='static', shape=engine.Plane())
    world.add_body('ball', shape=engine.Sphere(0.5), mass=1.0, position=(3, 0, 1))
    world.add_body('ghost', shape=engine.Box((1, 1, 1)), mass=1.0, position=(6, 0, 1), no_collision=True)
    before = world.state_hash
    hit = world.ray((0, 0, 1.3), (10, 0, 0))
    assert hit['body'] == 'ball' and hit['inside'] is False
    assert hit['distance'] == pytest.approx(2.6, abs=1e-14) and hit['point'] == pytest.approx((2.6, 0, 1.3), abs=1e-14)
    assert hit['normal'] == pytest.approx((-0.8, 0, 0.6), abs=1e-14)
    assert world.ray(np.array([0, 0, 1.0]), [1, 0, 0], ignored=['ball'])['body'] == 'ghost'
    assert world.ray((0, 0, 1), (1, 0, 0), max_distance=2.4) is None
    assert world.ray((0, 0, 1), (1, 0, 0), ignored=('ball', 'ghost')) is None
    inside = world.ray(origin=(3, 0, 1), direction=(0, 0, -3))
    assert inside == {'body': 'ball', 'distance': 0.0, 'point': (3, 0, 1), 'normal': (0, 0, 1), 'inside': True}
    assert world.state_hash == before
    for arguments, why in ((dict(direction=(0, 0, 0)), r'direction: must not be \(0, 0, 0\)'),
                           (dict(origin=(0, math.nan, 0)), 'origin: must be finite'),
                           (dict(origin=(0, 0)), 'origin: must be 3 numbers'),
                           (dict(max_distance=0), 'max_distance: must be a number > 0'),
                           (dict(ignored='ball'), 'ignored: must be a list of names'),
                           (dict(ignored=[3]), 'ignored: must be a list of names'),
                           (dict(ignored=['nobody']), "'nobody'")):
        with pytest.raises(ValueError, match=why):
            world.ray(**{'origin': (0, 0, 1), 'direction': (1, 0, 0), **arguments})
    with pytest.raises(TypeError, match="no argument 'ignore'"):
        world.ray((0, 0, 1), (1, 0, 0), ignore=['ball'])


def test_closest_points():
    world = engine.World()
    world.add_body('floor', type='static', shape=engine.Plane())
    world.add_body('ball', shape=engine.Sphere(0.5), mass=1.0, position=(3, 0, 2))
    world.add_body('box', shape=engine.Box((2, 2, 2)), mass=1.0, position=(0, 0, 2))
    found = world.closest_points('ball', 'box')
    assert found == {'distance': 1.5, 'point_a': (2.5, 0, 2), 'point_b': (1, 0, 2), 'normal': (1, 0, 0)}
    assert world.closest_points('box', 'floor')['distance'] == 1.0
    world.set_state('ball', position=(1.25, 0, 2))
    assert world.closest_points(body_a='ball', body_b='box')['distance'] == pytest.approx(-0.25, abs=1e-15)
    for names, why in ((('ball', 'ball'), 'body_b: must not be body_a'), (('ball', 'nobody'), "'nobody'"),
                       (('world', 'ball'), 'body_a: the world itself has no shape')):
        with pytest.raises(ValueError, match=why):
            world.closest_points(*names)


def test_bodies_in_a_region():
    world = engine.World()
    world.add_body('floor', type='static', shape=engine.Plane())
    world.add_body('ball', shape=engine.Sphere(0.5), mass=1.0, position=(3, 0, 1))
    world.add_body('mark', mass=1.0, position=(0, 0, 2))
    assert world.bodies_in((-9, -9, -9), (9, 9, 9)) == ['floor', 'ball', 'mark']
    assert world.bodies_in([3.5, 0, 1], [4, 1, 2]) == ['ball']
    assert world.bodies_in(np.array([3.6, 0, 1]), max=(4, 1, 2)) == []
    for corners, why in ((((0, 0, 0), (0, 0)), 'max: must be 3 numbers'),
                         (((0, math.inf, 0), (1, 1, 1)), 'min: must be finite'),
                         (((0, 0, 0), (1, -1, 1)), 'max: must be at least min')):
        with pytest.raises(ValueError, match=why):
            world.bodies_in(*corners)


def test_a_robot_of_an_sdf(tmp_path):
    """A file of SDF is added as one of a URDF is, with the YAML beside it."""
    world = engine.World(time_step=0.01)
    path = tmp_path / 'model.sdf'
    path.write_text('<sdf version="1.7"><model name="m"><plugin name="p" filename="p.so"/><link name="a"/>'
                    '<joint name="j" type="revolute"><parent>world</parent><child>a</child><axis><xyz>0 0 1</xyz>'
                    '</axis></joint></model></sdf>')
    (tmp_path / 'model.yaml').write_text('motors: {j: {bias: 0.5}}')
    try:
        robot = world.add_urdf_file(str(path), prefix='r/')
    except ValueError as error:
        if 'built without libsdformat' in str(error):
            pytest.skip(str(error))
        raise
    assert robot['name'] == 'm' and robot['constraints'] == ['r/j']
    assert any('<plugin> in <model>' in warning for warning in robot['warnings'])
    world.run(1.0)
    assert abs(world.joint_state('r/j')['coordinates'][0]['position'] - 0.5) < 1e-9  # a rigid motor


def test_stubs_name_what_there_is():
    """engine.pyi has every class, method, property and function of the module, and no others."""
    stubs = ast.parse((SOURCES / 'python/constraint_sim/engine.pyi').read_text())
    for node in stubs.body:
        if not isinstance(node, (ast.ClassDef, ast.FunctionDef)):
            continue
        if isinstance(node, ast.ClassDef) and node.bases and \
                getattr(node.bases[0], 'id', '') == 'TypedDict':
            continue
        there = getattr(engine, node.name)
        if isinstance(node, ast.ClassDef):
            stubbed = {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
            existing = {name for name in vars(there) if not name.startswith('_')}
            assert {name for name in stubbed if not name.startswith('_')} == existing, node.name
            for name in existing:
                assert inspect.getdoc(getattr(there, name)), f'{node.name}.{name} has a docstring'
    classes = {name for name, value in vars(engine).items() if inspect.isclass(value)}
    assert classes == {node.name for node in stubs.body if isinstance(node, ast.ClassDef)
                       and hasattr(engine, node.name)}
    keywords = next(item for node in stubs.body if getattr(node, 'name', '') == 'World'
                    for item in node.body if getattr(item, 'name', '') == '__init__')
    assert {argument.arg for argument in keywords.args.kwonlyargs} == set(engine.World().options)


def test_typed_dicts_of_the_stubs_have_the_keys_there_are():
    stubs = ast.parse((SOURCES / 'python/constraint_sim/engine.pyi').read_text())
    keys = {node.name: {item.target.id for item in node.body if isinstance(item, ast.AnnAssign)}
            for node in stubs.body if isinstance(node, ast.ClassDef)}
    world = hanging()
    world.step()
    assert keys['State'] == set(world.state('bob'))
    assert keys['JointState'] == set(world.joint_state('rod'))
    assert keys['JointWrench'] == set(world.joint_wrench('rod'))
    hinged = bar()
    hinged.add_joint('door', type='hinge', **BAR_END)
    assert keys['CoordinateState'] == set(hinged.joint_state('door')['coordinates'][0])
    assert keys['Island'] == set(world.islands()[0])
    verified = hanging(method='sequential_impulses', time_step=0.1).verify(0.5).bodies['bob']
    assert keys['VerifiedBody'] == set(verified)
    assert keys['VerifiedFigures'] == set(verified['exceeded'])
    world.add_joint('taut', body_a='world', body_b='bob', break_force=1e-3)
    world.step()
    assert keys['Event'] == set(world.events()[0])
    assert keys['RayHit'] == set(world.ray(world.positions[0], (1, 0, 0)))
    world.add_body('other', shape=engine.Sphere(0.1), mass=1.0)
    assert keys['ClosestPoints'] == set(world.closest_points('bob', 'other'))
    overlapping = engine.World(time_step=0.01)
    overlapping.add_body('box', shape=engine.Box((1, 1, 1)), mass=1.0)
    overlapping.add_body('ball', shape=engine.Sphere(0.4), mass=1.0, position=(0, 0, 0.3))
    overlapping.step()
    assert overlapping.report.overlap_body is not None
    warning = next(each for each in overlapping.step_warnings() if each['kind'] == 'overlap')
    assert keys['StepWarning'] == set(warning)
    assert warning['value'] == overlapping.report.overlap and warning['unit'] == 'm'
    assert warning['text'].endswith(': ' + warning['advice']) and not warning['is_notice']


def test_python_knows_every_key_of_a_scene():
    """Keys of worlds, bodies, distance joints and motors that the engine saves are keywords here."""
    world = hanging()
    world.set_motor('rod', bias=0.1)
    saved = yaml.safe_load(world.save_scene())
    assert set(saved['world']) == set(world.options)
    assert set(saved['bodies'][0]) | {'shape_pose'} == set(world.body('bob'))  # saved where there is one
    # keys of a saved joint: a rod has no limits, a soft joint no length of its own kind
    assert set(saved['constraints'][0]) <= set(world.joint('rod'))
    assert set(saved['constraints'][0]['motor']) == set(world.joint('rod')['motor'])


def test_examples():
    lines = run_example('pendulum.py').splitlines()
    assert len(lines) == 11
    for line in lines:  # measured and closed form agree to the printed digits
        words = line.replace(',', '').split()
        assert float(words[2]) == pytest.approx(float(words[6]), abs=1e-10)
    assert 'mean 0.1' in run_example('monte_carlo.py')
    last = run_example('controller.py').splitlines()[-1].split()
    assert abs(float(last[3])) < 1e-3, 'the rod stands'


def test_manual_examples(tmp_path):
    """Every Python block of docs/python.md runs, all in one process in order."""
    blocks = (SOURCES / 'docs/python.md').read_text().split('```python\n')[1:]
    assert len(blocks) >= 3
    code = '\n'.join(block.split('```')[0] for block in blocks)
    script = tmp_path / 'manual.py'
    script.write_text(f'import sys; sys.path[:0] = {sys.path!r}\n' + code)
    subprocess.run([sys.executable, script], check=True, cwd=pathlib.Path(SOURCES),
                   stdout=subprocess.DEVNULL)
