#!/usr/bin/env python3
"""How far does a load swing on a rope when masses are known to 20 %? 200 worlds on all cores."""
import concurrent.futures
import os

import numpy as np

from constraint_sim import engine

SCENE = """
world: {time_step: 0.005}
bodies:
  - {name: trolley, mass: 10, position: [0, 0, 5], linear_velocity: [1, 0, 0]}
  - {name: load, mass: 5, position: [0, 0, 3]}
constraints:
  - {name: cable, body_a: trolley, body_b: load}
  - {name: brake, type: spring, anchor_a: [0, 0, 5], body_b: trolley, length: 0, stiffness: 200, damping: 40}
wrenches:
  - {body: trolley, force: [0, 0, 147.15]}
"""


def swing(masses):
    """Largest distance of the load from the middle in 5 s [m]."""
    start = engine.load_scene(SCENE)
    world = engine.World(**start.options)
    for name, mass in zip(start.body_names, masses):
        world.add_body(**{**start.body(name), 'mass': mass})
    for name in start.joint_names:
        world.add_joint(**start.joint(name))
    world.add_wrench('trolley', force=(0, 0, 9.81 * sum(masses)))
    samples = world.run(5.0, every=4)  # other threads run meanwhile: no GIL is held
    return np.abs(samples.states[:, world.index('load'), 0]).max()


masses = np.array([10.0, 5.0]) * (1.0 + 0.2 * np.random.default_rng(seed=1).standard_normal((200, 2)))
with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
    swings = np.array(list(pool.map(swing, np.maximum(masses, 0.1))))
print(f'swing: mean {swings.mean():.3f} m, 95 % below {np.quantile(swings, 0.95):.3f} m')
