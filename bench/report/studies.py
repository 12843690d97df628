"""The grids of the report: studies/*.yaml, in the words of docs/sweeps.md. Their scenes are problems
of bench/report/problems, `graded` and `extreme` are those with and without a diagram; their methods are
contestants, which may be restricted to some scenes."""
import collections
import pathlib

import yaml

import package_path  # noqa: F401
from constraint_sim.sweep import expressions

FOLDER = pathlib.Path(__file__).parent / 'studies'

Study = collections.namedtuple('Study', 'scenes counts methods time_steps rounds time_limit')
Method = collections.namedtuple('Method', 'name scenes')  # None: all scenes
KEYS = {'scenes', 'parameters', 'methods', 'time_steps', 'rounds', 'time_limit'}
PARTS = ('diagrams', 'grid', 'many', 'sizes')


def method(value):
    return Method(value['name'], value['scenes']) if isinstance(value, dict) else Method(value, None)


def load(part, folder=FOLDER):
    path = pathlib.Path(folder) / f'{part}.yaml'
    found = yaml.safe_load(path.read_text())
    if set(found) - {'parameters'} != KEYS - {'parameters'}:
        raise ValueError(f'{path}: must have {", ".join(sorted(KEYS))}, has {", ".join(found)}')
    return Study(
        scenes=found['scenes'] if isinstance(found['scenes'], list) else [found['scenes']],
        counts=found.get('parameters', {'count': {'values': []}})['count']['values'],
        methods=None if found['methods'] == 'all' else [method(each) for each in found['methods']],
        time_steps=[float(expressions.value(str(step))) for step in found['time_steps']],
        rounds=found['rounds'], time_limit=float(found['time_limit']))


def runs(study, scene, contestant):
    """Returns whether the study runs this contestant on this scene, or kind of scene."""
    return study.methods is None or any(
        contestant == each.name and (each.scenes is None or scene in each.scenes)
        for each in study.methods)
