#!/usr/bin/env python3
"""Builds a chain in a running simulator, swings it, and tries something that is then undone.

  rosrun constraint_sim constraint_sim_node &
  python3 examples/client.py
"""
import rospy
from constraint_sim_client import Refused, Simulator

LINKS = 20

rospy.init_node('client_example')
simulator = Simulator('/constraint_sim')
with simulator.paused() as sim:
    sim.load(text='world: {time_step: 0.01}')
    with sim.batch() as batch:  # one tick, all or nothing
        for i in range(LINKS):
            batch.add_sphere('ball_%d' % i, radius=0.02, mass=0.1, position=(0.1 * (i + 1), 0, 2),
                             no_collision=True)
            batch.add_constraint('rod_%d' % i, 'distance',
                                 body_a='ball_%d' % (i - 1) if i else '', body_b='ball_%d' % i,
                                 anchor_a=(0, 0, 0) if i else (0, 0, 2))
    sim.step(100)
    before = sim.properties().state_hash
    with sim.tried():  # tries a last ball that is a hundred times as heavy
        sim.set_body('ball_%d' % (LINKS - 1), mass=10.0)
        sim.step(100)
        z = sim.state('ball_%d' % (LINKS - 1)).pose.position.z
        print('with a heavy end, after a second more: z = %.3f m' % z)
    assert sim.properties().state_hash == before  # to the bit
    sim.step(100)
    z = sim.state('ball_%d' % (LINKS - 1)).pose.position.z
    print('as it is, after a second more: z = %.3f m' % z)
    try:
        sim.add_sphere('ball', radius=-1.0, mass=1.0)
    except Refused as refused:
        print(refused)
