"""The study of `--report`: how wrong and how dear is each method on a scene, and where does it break?"""
import pathlib

import yaml

from .study import Study, StudyError, number

TICKS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)  # [s]


def report_study(path, duration, peers):
    path = pathlib.Path(path)
    if abs(round(number('--duration', duration, 0.0) / TICKS[0]) * TICKS[0] - duration) > 1e-9:
        raise StudyError(f'--duration: must be a multiple of {TICKS[0]} s, got {duration:g}')
    study = {
        'scene': path.name, 'duration': duration, 'outputs': {'every': TICKS[0]},
        'methods': [
            'auto',
            {'name': 'runge_kutta_order_8', 'method': 'runge_kutta'},
            {'name': 'runge_kutta_order_5', 'method': 'runge_kutta', 'order': 5},
            {'name': 'energy_momentum_order_4', 'method': 'energy_momentum'},
            {'name': 'energy_momentum_order_2', 'method': 'energy_momentum', 'stiff_order': 2},
            {'name': 'sequential_impulses_10', 'method': 'sequential_impulses'},
            {'name': 'sequential_impulses_50', 'method': 'sequential_impulses', 'iterations': 50},
        ],
        'time_steps': list(TICKS), 'rounds': 3,
        # half the tick and a tenth of the tolerance of anything it is compared with
        'reference': {'run': {'method': 'auto', 'tolerance': 1e-11, 'time_step': TICKS[-1] / 2.0}},
        'plots': [{'x': 'time_step', 'y': measure} for measure in
                  ('position_error', 'max_constraint_error', 'energy_drift', 'run_time')],
    }
    study['methods'] += [{'name': label.replace(' ', '_'), 'peer': label} for label in peers
                         if not label.startswith('constraint_sim ')]
    return Study(yaml.safe_dump(study), path.parent, f'report of {path}', peers)
