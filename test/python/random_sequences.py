"""Random sequences of edits, steps, copies, saves and snapshots through Python, with right and wrong arguments.

    random_sequences.py [--count N] [--first SEED] [--seconds S]

A call either has its documented effect or raises ValueError, TypeError or RuntimeError and changes nothing. Copies and
saved worlds continue like the world. A violation ends the run with its seed, which repeats it.
"""
import argparse
import copy
import math
import random
import sys
import time

import numpy as np

from constraint_sim import engine

REJECTIONS = (ValueError, TypeError, RuntimeError)
TYPES = ('distance', 'ball', 'hinge', 'slider', 'cylindrical', 'planar', 'universal', 'weld', 'point_on_line',
         'point_on_plane', 'parallel', 'gear', 'pulley', 'screw', 'magic')
EDITS = 40  # edits per sequence


class Finding(Exception):
    """A violation of a guarantee."""


def require(holds, sentence):
    if not holds:
        raise Finding(sentence)


class Odd:
    """An argument of an own class, whose conversion may do anything."""

    def __init__(self, value, action=None):
        self.value, self.action = value, action

    def __float__(self):
        if self.action:
            self.action()
        return float(self.value)


class Sequence:
    """One sequence; its random draws depend on the seed alone."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.world = engine.World()
        self.attempt(lambda: self.world.set_options(**self.options()))
        self.kept = None  # a copy, and its hash

    def run(self):
        for _ in range(EDITS):
            self.random.choice((self.add_body, self.add_joint, self.edit, self.edit, self.step, self.step, self.copy,
                                self.save, self.ask, self.restore))()
        self.step()

    # ---- arguments

    def number(self):
        anything = (0.0, 1, True, '1', None, math.inf, -math.inf, math.nan, 1e20, 1e-20, 1e300, 10 ** 400, -5,
                    np.float32(0.5), np.int64(2), np.array(3.0), np.array([4.0]), [1.0], Odd(1.5),
                    Odd(0.5, lambda: self.world.body_names), Odd(0.5, self.interfere), object(), b'1', 1j)
        return self.random.uniform(-2.0, 2.0) if self.random.random() < 0.9 else self.random.choice(anything)

    def interfere(self):
        """Does something that another part of a program might do meanwhile."""
        if self.world.body_names and self.random.random() < 0.5:
            self.world.remove_body(self.random.choice(self.world.body_names))

    def size(self):
        number = self.number()
        return abs(number) if isinstance(number, float) else number

    def vector(self, count=3):
        numbers = [self.number() for _ in range(count if self.random.random() < 0.97 else self.random.randrange(9))]
        kind = self.random.randrange(12)
        if kind == 0:
            return iter(numbers)
        if kind == 1:
            try:
                return np.array(numbers, dtype=float)
            except (TypeError, ValueError, OverflowError):
                return np.zeros(count)
        if kind == 2:  # shortens itself while it is read
            numbers[:1] = [Odd(1.0, numbers.clear)]
        return numbers if kind < 8 else tuple(numbers)

    def unit(self):
        numbers = [self.random.gauss(0.0, 1.0) for _ in range(4)]
        length = math.sqrt(sum(x * x for x in numbers))
        return [x / length for x in numbers] if self.random.random() < 0.9 else self.vector(4)

    def shape(self):
        kinds = (engine.Point, lambda: engine.Sphere(self.size()), lambda: engine.Box(self.vector()), engine.Plane,
                 lambda: engine.Cylinder(self.size(), self.size()), lambda: engine.Capsule(self.size(), self.size()),
                 lambda: engine.Box((0.3, 0.4, 0.5)), lambda: 'ball')
        try:
            return self.random.choice(kinds)()
        except REJECTIONS:
            return engine.Sphere(0.2)

    def some(self, **values):
        """Returns keyword arguments, each drawn by its function with its probability."""
        return {key: draw() for key, (chance, draw) in values.items() if self.random.random() < chance}

    def body(self):
        return self.random.choice([*self.world.body_names, 'world', 'nobody'])

    def joint(self):
        return self.random.choice([*self.world.joint_names, 'none'])

    def state(self, chance):
        return self.some(position=(chance, self.vector), orientation=(0.5, self.unit),
                         linear_velocity=(0.5, self.vector), angular_velocity=(0.5, self.vector))

    def motor(self):
        return self.some(bias=(0.8, self.number), amplitude=(0.3, self.number), frequency=(0.3, self.size),
                         phase=(0.2, self.number), max_force=(0.3, self.size), timeout=(0.2, self.size))

    def coordinate_motor(self):
        return {**self.motor(), **self.some(position=(0.3, self.number), servo_frequency=(0.2, self.size),
                                            servo_stiffness=(0.1, self.size), servo_damping=(0.1, self.size),
                                            force=(0.2, self.number))}

    def law(self):
        return self.some(lower=(0.3, self.number), upper=(0.3, self.number), limit_restitution=(0.2, self.size),
                         friction=(0.2, self.size), damping=(0.2, self.size), stiffness=(0.2, self.size),
                         rest=(0.1, self.number), frequency=(0.1, self.size), damping_ratio=(0.1, self.size),
                         position=(0.1, self.number), motor=(0.4, self.coordinate_motor))

    def distance(self):
        return self.some(length=(0.5, self.size), min_length=(0.2, self.size), max_length=(0.2, self.size),
                         frequency=(0.1, self.size), damping_ratio=(0.1, self.size), stiffness=(0.2, self.size),
                         damping=(0.2, self.size), motor=(0.3, self.motor))

    def options(self):
        return self.some(
            time_step=(0.3, lambda: self.random.choice((0.01, 1 / 60, 0.1, 0.001, 0.0, 1e-12, 1e6, 'fast'))),
            method=(0.4, lambda: self.random.choice((*engine.METHODS, 'magic'))), gravity=(0.2, self.vector),
            tolerance=(0.1, self.size), order=(0.1, lambda: self.random.choice((5, 8, 7))),
            stiff_order=(0.1, lambda: self.random.choice((2, 4))), iterations=(0.1, lambda: self.random.choice((0, 1, 30))),
            baumgarte=(0.1, self.size), closing_time=(0.1, self.size), sleep_after=(0.1, self.size),
            stiffness_limit=(0.1, self.size), contact_tolerance=(0.1, self.size),
            dissipation=(0.1, lambda: self.random.choice((True, False, 1))))

    # ---- calls

    def attempt(self, call):
        """Makes a call; a rejected call must change nothing, unless an argument did."""
        before, names = self.world.state_hash, self.world.body_names
        try:
            return call()
        except REJECTIONS as rejection:
            if self.world.body_names == names:
                require(self.world.state_hash == before, f'a rejected call has changed the world: {rejection}')
            return None

    def add_body(self):
        if len(self.world.body_names) < 8:
            arguments = {'mass': self.size(), 'shape': self.shape(), **self.state(0.9),
                         **self.some(type=(0.2, lambda: self.random.choice(('static', 'kinematic', 'ghost'))),
                                     inertia=(0.2, self.vector), friction=(0.4, self.size),
                                     restitution=(0.2, self.size), no_collision=(0.2, lambda: True))}
            self.attempt(lambda: self.world.add_body(f'b{self.random.randrange(12)}', **arguments))

    def add_joint(self):
        if len(self.world.joint_names) >= 10:
            return
        kind = self.random.choice(TYPES)
        arguments = {'type': kind, **self.some(
            body_a=(0.6, self.body), anchor_a=(0.5, self.vector), anchor_b=(0.5, self.vector),
            break_force=(0.1, self.size), baumgarte=(0.1, self.number), collide_connected=(0.2, lambda: True),
            enabled=(0.1, lambda: False), broken=(0.1, lambda: True))}
        if kind in ('gear', 'pulley'):
            arguments = {'type': kind, 'joints': (self.joint(), self.joint()), 'ratio': self.number()}
        else:
            arguments['body_b'] = self.body()
        if kind == 'screw':
            arguments['pitch'] = self.number()
        if kind == 'distance':
            arguments.update(self.distance())
        elif kind not in ('ball', 'distance', 'gear', 'pulley', 'weld'):
            arguments.update(self.some(axis_a=(0.4, self.vector), frame_b=(0.2, self.unit)))
            arguments.update(self.law() if self.random.random() < 0.7 else
                             {'coordinates': [self.law() for _ in range(self.random.randrange(4))]})
        self.attempt(lambda: self.world.add_joint(f'j{self.random.randrange(14)}', **arguments))

    def edit(self):
        world, joint, body = self.world, self.joint(), self.body()
        calls = (
            lambda: world.remove_body(body),
            lambda: world.remove_joint(joint),
            lambda: world.set_state(body, **self.state(0.6)),
            lambda: world.set_motor(joint, **self.coordinate_motor()),
            lambda: world.set_motor(joint, coordinate=self.random.randrange(-1, 4), removed=self.random.random() < 0.5),
            lambda: world.set_joint(joint, **{**self.some(break_force=(0.2, self.size), enabled=(0.2, lambda: True)),
                                              **(self.law() if self.random.random() < 0.5 else self.distance())}),
            lambda: world.set_broken(joint, self.random.random() < 0.5),
            lambda: world.set_enabled(joint, self.random.random() < 0.5),
            lambda: world.add_wrench(body, **self.some(force=(0.9, self.vector), torque=(0.4, self.vector),
                                                       start=(0.2, self.number), duration=(0.6, self.size))),
            lambda: world.clear_wrenches(body),
            lambda: world.set_options(**self.options()),
            lambda: world.set_time(self.number(), self.random.choice((0, 7, 2 ** 40))),
            world.reset,
        )
        self.attempt(self.random.choice(calls))

    def step(self):
        positions = self.world.positions
        report = self.world.step() if self.random.random() < 0.8 else self.world.run(
            self.world.options['time_step'] * self.random.randrange(4), time_limit=0.2)
        if not report.failed:
            require(np.isfinite(self.world.states).all(), 'a state is not finite and the step has not failed')
            require(math.isfinite(self.world.energy), 'the energy is not finite and the step has not failed')
            for name in self.world.joint_names:
                state = self.world.joint_state(name)
                require(all(math.isfinite(state[key]) for key in ('error', 'force', 'travel')),
                        f'the state of joint {name} is not finite and the step has not failed')
        names = self.world.body_names
        require(positions.shape == (len(names), 3), 'an array has another shape than there are bodies')
        require(all(tuple(row) == self.world.state(name)['position'] for row, name in zip(positions, names)),
                'an array does not follow the world')

    def copy(self):
        other = copy.deepcopy(self.world)
        require(other.state_hash == self.world.state_hash, 'a copy has another hash')
        other.step()
        self.world.step()
        require(other.state_hash == self.world.state_hash, 'a copy does not go on as its world')
        self.kept = (other, other.state_hash)

    def restore(self):
        if self.kept is None:
            return
        other, before = self.kept
        require(other.state_hash == before, 'a copy has changed by itself')
        self.world.restore(other)
        require(self.world.state_hash == before, 'a restored world has another hash than its copy')

    def save(self):
        text = self.world.save_scene()
        again = engine.load_scene(text)
        require(again.save_scene() == text, 'a saved scene is saved otherwise once it is loaded')

    def ask(self):
        world, before = self.world, self.world.state_hash
        world.islands(), world.contacts(), world.events(), world.explain(), world.left_out()
        world.doubtful_settings(), world.unresolved_bodies(), repr(world), world.options
        for name in world.body_names:
            world.body(name)
        for name in world.joint_names:
            joint = world.joint(name)
            world.opening(name)
            if joint['type'] not in ('gear', 'pulley'):
                world.joint_wrench(name)
        require(world.state_hash == before, 'a question has changed the world')


def run(first, count, seconds=math.inf):
    """Returns the number of sequences that were run. Raises Finding with the seed."""
    ends = time.monotonic() + seconds
    for seed in range(first, first + count):
        if time.monotonic() > ends:
            return seed - first
        try:
            Sequence(seed).run()
        except Finding as finding:
            raise Finding(f'seed {seed}: {finding}') from None
        except Exception as error:
            raise Finding(f'seed {seed}: {type(error).__name__}: {error}') from error
    return count


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--count', type=int, default=10000, help='sequences; default: 10000')
    parser.add_argument('--first', type=int, default=0, metavar='SEED', help='of the first sequence; default: 0')
    parser.add_argument('--seconds', type=float, default=math.inf, help='after which no sequence is begun')
    options = parser.parse_args()
    done = run(options.first, options.count, options.seconds)
    print(f'{done} sequences of {EDITS} calls without a finding')


if __name__ == '__main__':
    sys.exit(main())
