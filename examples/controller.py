#!/usr/bin/env python3
"""A controller in the loop: a force on a cart balances the rod that stands on it."""
from constraint_sim import engine

TICK = 0.005  # [s]
world = engine.World(time_step=TICK, gravity=(0, 0, -9.81))
world.add_body('cart', mass=1.0)
world.add_body('tip', mass=0.2, position=(0.1, 0, 0.995))
world.add_joint('rod', body_a='cart', body_b='tip')
cart, tip = world.index('cart'), world.index('tip')
positions, velocities = world.positions, world.linear_velocities  # follow the world, no copies

for tick in range(2000):
    lean = positions[tip, 0] - positions[cart, 0]
    lean_rate = velocities[tip, 0] - velocities[cart, 0]
    force = 60.0 * lean + 12.0 * lean_rate + 2.0 * positions[cart, 0] + 4.0 * velocities[cart, 0]
    lift = 9.81 * 1.2 - 2000.0 * positions[cart, 2] - 100.0 * velocities[cart, 2]  # the rail
    world.add_wrench('cart', force=(force, 0, lift), duration=TICK)
    world.step()
    if tick % 200 == 199:
        print(f'{world.time:5.2f} s: lean {lean: .2e} m, cart at {positions[cart, 0]: .2e} m, force {force: .2e} N')
