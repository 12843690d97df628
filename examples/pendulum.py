#!/usr/bin/env python3
"""A pendulum of 1 m at small angle against its closed form, in ten lines."""
import math

from constraint_sim import engine

world = engine.World(time_step=0.01)
angle = 1e-4  # [rad]: the period depends on its square, by 1e-9 of itself over 16
world.add_body('bob', mass=1.0, position=(math.sin(angle), 0, -math.cos(angle)))
world.add_joint('rod', body_b='bob')
samples = world.run(10.0, every=1)
for time, state in zip(samples.times[::100], samples.states[::100, world.index('bob')]):
    exact = angle * math.cos(math.sqrt(9.81) * time)
    print(f'{time:5.2f} s: {math.asin(state[0]): .6e} rad, closed form {exact: .6e} rad')
