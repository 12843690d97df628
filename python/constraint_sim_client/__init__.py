"""A running simulator, from Python: docs/clients.md.

    with Simulator().paused() as sim:
        sim.add_sphere('bob', radius=0.1, mass=1.0, position=(1, 0, 2))
        sim.add_constraint('rod', 'distance', body_b='bob', anchor_b=(0, 0, 0.1))
        sim.step(100)
        print(sim.state('bob').pose.position)

Units are SI, positions and twists are in the world frame.
"""
from constraint_sim_client.simulator import Batch, Joint, Refused, Simulator

__all__ = ['Batch', 'Joint', 'Refused', 'Simulator']
