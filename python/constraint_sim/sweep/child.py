"""Runs cases: in this process, or as the main program of a process of their own."""
import resource
import sys
import time

import numpy as np

from .. import engine
from . import expressions, peers

COMPONENTS = ('px', 'py', 'pz', 'qx', 'qy', 'qz', 'qw', 'vx', 'vy', 'vz', 'wx', 'wy', 'wz')
CONSERVED = 1e-6  # change of the reference's energy over its scale, below which energy is conserved
REFERENCE_PATIENCE = 10.0  # times the limit of a case: what the reference may take
SUMS = ('substeps', 'rejected', 'iterations', 'rows', 'contacts', 'changes')


def samples_of(text, case, time_limit):
    """(world, run report, times, states of all samples), states by the bodies that count."""
    world = engine.load_scene(text)
    run = world.run(case['duration'], every=case['stride'], time_limit=time_limit)
    names = world.body_names
    rows = [names.index(name) for name in case['bodies']]
    return world, run, run.times, run.states[:, rows]


def differences(states, reference):
    """Largest distance [m] and angle [rad] of two trajectories; components not known are NaN and do
    not count. NaN where nothing is known."""
    squares = (states[..., :3] - reference[..., :3]) ** 2
    known = ~np.isnan(squares)
    distance = np.sqrt(np.where(known, squares, 0.0).sum(-1)).max() if known.any() else np.nan
    a, b = states[..., 3:7], reference[..., 3:7]
    if np.isnan(b).any(-1).all():
        return float(distance), np.nan
    # angle of conj(a) b: 2 asin of its vector part, also where it is small
    vector = (a[..., 3:] * b[..., :3] - b[..., 3:] * a[..., :3] - np.cross(a[..., :3], b[..., :3]))
    length = np.minimum(np.sqrt((vector ** 2).sum(-1)), 1.0)
    return float(distance), float(np.nanmax(2.0 * np.arcsin(length)))


def farthest(states):
    """How far a body came from its start at most [m]."""
    with np.errstate(all='ignore'):
        return float(np.sqrt(((states[..., :3] - states[0, :, :3]) ** 2).sum(-1)).max(initial=0.0))


class Reference:
    """Reference run of a group of cases, at every multiple of `interval`."""

    def __init__(self, job, begin):
        self.times, self.states, self.own_error = None, None, np.nan
        self.size = self.energy_scale = self.energy_change = self.energy_final = np.nan
        reference = job['reference']
        if reference is None:
            return
        if 'states' in reference:
            self.times, self.states = reference['times'], reference['states']
        elif 'runs' in reference:
            tight, looser = reference['runs']
            limit = REFERENCE_PATIENCE * job['time_limit']
            begin('reference')
            world, run, self.times, self.states = samples_of(tight['text'], tight, limit)
            if run.failed or run.timed_out:
                raise RuntimeError('the reference run ' + ('failed' if run.failed else 'was too slow'))
            self.measure(world, run, tight['bodies'])
            begin('reference')
            _, run, times, states = samples_of(looser['text'], looser, limit)
            if not (run.failed or run.timed_out):
                self.own_error = max(differences(*self.common(times, states)))

    def measure(self, world, run, names):
        """The size of the box in which bodies move [m], and the scale of the energy [J]: the largest kinetic
        one, and of what hardly moves 1 % of its weight over that size."""
        bodies = [world.body(name) for name in names]
        masses = np.array([body['mass'] if body['type'] == 'dynamic' else 0.0 for body in bodies])
        moving = self.states[:, masses > 0.0, :]
        if moving.size == 0:
            return
        self.size = float(np.linalg.norm(np.ptp(moving[..., :3].reshape(-1, 3), axis=0)))
        kinetic = float((0.5 * masses[masses > 0.0] * (moving[..., 7:10] ** 2).sum(-1)).sum(-1).max())
        weight = float(masses.sum() * np.linalg.norm(world.options['gravity']) * self.size)
        scale = max(kinetic, 0.01 * weight)
        if scale > 0.0:
            self.energy_scale, self.energy_final = scale, run.energy_final
            self.energy_change = abs(run.energy_final - run.energy_initial) / scale

    def common(self, times, states):
        """States of a run and of the reference where both have one."""
        at = np.searchsorted(self.times, times - 1e-9 * np.maximum(times, 1.0))
        at = np.minimum(at, len(self.times) - 1)
        both = np.abs(self.times[at] - times) <= 1e-6 * np.maximum(times, 1e-3)
        return states[both], self.states[at[both]]

    def errors(self, closed_form, case, times, states):
        if closed_form is not None:
            reference = np.full_like(states, np.nan)
            variables = {**closed_form['variables'], 't': times}
            for body, components in closed_form['bodies'].items():
                for name, text in components.items():
                    reference[:, case['bodies'].index(body), COMPONENTS.index(name)] = \
                        expressions.value(text, variables)
            return differences(states, reference)
        if self.states is None:
            return np.nan, np.nan
        return differences(*self.common(times, states))


def run_peer(case, job, reference):
    """(run time [s], result) of another engine."""
    outcome, detail, run_time, figures, times, states = peers.run(case, job['time_limit'])
    result = {'outcome': outcome, 'warnings': detail, **figures}
    if states is None:
        return run_time, result
    names = engine.load_scene(case['text']).body_names
    measured = states[:, [names.index(name) for name in case['bodies']]]
    with np.errstate(all='ignore'):
        position, orientation = reference.errors(
            (job['reference'] or {}).get('closed_form'), case, times, measured)
    result.update({'steps': round(times[-1] / case['peer']['tick']), 'sim_time': float(times[-1]),
                   'position_error': position, 'orientation_error': orientation,
                   'reference_error': reference.own_error, 'distance': farthest(measured),
                   'scene_size': reference.size})
    if reference.energy_change < CONSERVED:  # the drift is relative to the start
        result['energy_error'] = figures['energy_drift']
    for name in case['states']:
        for component, number in zip(COMPONENTS, states[-1, names.index(name)]):
            result[f'{name}.{component}'] = float(number)
    if case['keeps_samples']:
        result['samples'] = (times, measured)
    return run_time, result


def run_case(case, job, reference, wants_all):
    """(run time [s], result); the result only where it is wanted."""
    if 'peer' in case:
        return run_peer(case, job, reference)
    begun = time.process_time()
    world, run, times, states = samples_of(case['text'], case, job['time_limit'])
    # both are at least what it took: the one counts what others had of the processor, the other what
    # samples and reports took
    run_time = min(run.wall_time, time.process_time() - begun)
    if not wants_all:
        return run_time, None
    with np.errstate(all='ignore'):
        position, orientation = reference.errors(
            (job['reference'] or {}).get('closed_form'), case, times, states)
    warnings = []
    if run.failed:
        warnings.append(run.failure + (f": '{run.failed_body}'" if run.failed_body else ''))
    warnings.extend(world.doubtful_settings())
    if run.unresolved_bodies:
        warnings.append(f'{len(run.unresolved_bodies)} bodies are not resolved')
    if run.unclosed_joints:  # the runner warns as well
        warnings.append('errors of joints are not being closed')
    if run.energy_rise > 0.0:
        warnings.append('energy rose without a cause')
    if run.overlap > 0.0:
        warnings.append('contacts by impulses overlap')
    if run.creep > 0.0:
        warnings.append('contacts by impulses creep')
    if run.torn_joints:
        warnings.append(f'{run.torn_joints} joints broke')
    if reference.own_error > 0.1 * max(position, orientation):
        warnings.append('the reference is hardly more exact')
    result = {
        'outcome': 'failed' if run.failed else 'too_slow' if run.timed_out else 'ok',
        'steps': run.steps, 'sim_time': world.time, 'state_hash': f'0x{world.state_hash:016x}',
        'position_error': position, 'orientation_error': orientation,
        'reference_error': reference.own_error,
        'max_constraint_error': run.max_constraint_error, 'max_penetration': run.max_penetration,
        'accumulated_local_error': run.accumulated_local_error,
        'energy_initial': run.energy_initial, 'energy_final': run.energy_final,
        'energy_drift': run.energy_drift, 'energy_error': np.nan if run.timed_out
        else abs(run.energy_final - reference.energy_final) / reference.energy_scale,
        'distance': farthest(states), 'scene_size': reference.size, 'correction_work': run.correction_work,
        'driven_work': run.driven_work, 'solver_residual': run.solver_residual,
        **{name: getattr(run, name) for name in SUMS},
        'energy_rise': run.energy_rise, 'unclosed_joints': len(run.unclosed_joints),
        'torn_joints': run.torn_joints, 'unresolved_bodies': len(run.unresolved_bodies),
        'methods': '+'.join(sorted(run.methods)), 'warnings': '; '.join(warnings),
    }
    for name in case['states']:
        for component, number in zip(COMPONENTS, world.states[world.index(name)]):
            result[f'{name}.{component}'] = float(number)
    if case['keeps_samples']:
        result['samples'] = (times, states)
    return run_time, result


def run_group(job, begin, done, reached):
    """All cases of a group, its rounds interleaved: run times are compared within one process.
    `begin(key)` before each run, `reached(key, share)` after it, `done(key, result)` for each case."""
    try:
        reference = Reference(job, begin)
        trouble = job.get('trouble', '')
    except Exception as error:
        reference, trouble = Reference({'reference': None}, begin), f'no reference: {error}'
        job = {**job, 'reference': None}
    results, times = {}, {}
    for number in range(job['rounds']):
        for case in job['cases']:
            key = case['key']
            if number > 0 and results[key]['outcome'] != 'ok':
                continue
            begin(key)
            try:
                run_time, result = run_case(case, job, reference, number == 0)
            except Exception as error:  # the engine took the scene before, so something is amiss
                run_time, result = np.nan, {'outcome': 'refused', 'warnings': str(error)}
            times.setdefault(key, []).append(run_time)
            if result is not None and number == 0:
                if trouble:
                    result['warnings'] = '; '.join(filter(None, [result['warnings'], trouble]))
                results[key] = result
            if number == job['rounds'] - 1 or results[key]['outcome'] != 'ok':
                best = min(times[key])
                results[key]['run_time'] = best
                results[key]['run_time_spread'] = float(np.median(times[key]) / best - 1.0) \
                    if len(times[key]) > 1 and best > 0.0 else np.nan
                done(key, results[key])
                reached(key, 1.0)
            else:
                reached(key, (number + 1) / job['rounds'])


def main(connection, memory):
    if memory:
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    connection.send(('ready',))
    while True:
        try:
            job = connection.recv()
        except (EOFError, OSError):
            return
        run_group(job, lambda key: connection.send(('begin', key)),
                  lambda key, result: connection.send(('done', key, result)),
                  lambda key, share: connection.send(('reached', key, share)))
        connection.send(('finished',))


if __name__ == '__main__':
    from multiprocessing.connection import Connection
    main(Connection(int(sys.argv[1])), int(sys.argv[2]))
