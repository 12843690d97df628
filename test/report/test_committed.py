#!/usr/bin/env python3
"""Checks the committed report against the grids of bench/report/studies: from the committed
figures, those of the studies and no others, the committed summary follows to the byte.

test_committed.py PROGRAM, where PROGRAM is constraint_sim_report_engine, which knows the problems.
"""
import csv
import math
import pathlib
import re
import sys
import tempfile
import unittest
from unittest import mock

PACKAGE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / 'bench' / 'report'))
import cells  # noqa: E402
import pages  # noqa: E402
import report  # noqa: E402
import studies  # noqa: E402

REPORT = PACKAGE / 'docs' / 'report'
STUDIES = report.STUDIES
CONDITIONS = re.compile(r'- engines: (?P<engines>.*)\n- absent peers: none\n'
                        r'- (?P<kind>\w+) run, measured in (?P<taken>.*); each time the best of (?P<rounds>\d+) .*\n'
                        r'- budget of a run: (?P<budget>\S+) s, in the stability grid (?P<grid>\S+) s, '
                        r'with many bodies (?P<many>\S+) s, of a size (?P<sizes>\S+) s\n')


def read(name):
    with open(REPORT / name, newline='') as file:
        return list(csv.DictReader(file))


def is_among(value, steps):
    """Returns whether a value is among these, to the six digits of the tables."""
    return any(math.isclose(float(value), step, rel_tol=1e-5) for step in steps)


class Committed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.problems = cells.problems(PROGRAM)
        cls.graded = [p.name for p in cls.problems.values() if p.graded and report.is_in_report(p, 'full')]
        cls.extreme = [p.name for p in cls.problems.values() if not p.graded]

    def scenes(self, part):
        """Returns the names of problems that a study has."""
        groups = {'graded': self.graded, 'extreme': self.extreme}
        return {name for scene in STUDIES[part].scenes for name in groups.get(scene, [scene])}

    def is_asked_for(self, part, row):
        scale = self.problems[row['problem']].tick_scale if part == 'grid' else 1.0
        return row['problem'] in self.scenes(part) and \
            studies.runs(STUDIES[part], row['problem'], row['contestant']) and \
            (row['knob'] != 'tick' or
             is_among(row['value'], [scale * step for step in STUDIES[part].time_steps]))

    def test_each_table_has_what_its_study_asks_for(self):
        for part, name in (('diagrams', 'cells'), ('grid', 'grid'), ('many', 'many')):
            rows = read(f'{name}.csv')
            left = [row for row in rows if not self.is_asked_for(part, row)]
            self.assertEqual(left[:1], [], f'{part}: {len(left)} rows')
            self.assertEqual({row['problem'] for row in rows}, self.scenes(part))
            found = {f'{float(row["value"]):.6g}' for row in rows if row['knob'] == 'tick' and
                     (part != 'grid' or self.problems[row['problem']].tick_scale == 1.0)}
            self.assertEqual(found, {f'{step:.6g}' for step in STUDIES[part].time_steps})
        sizes = {(row['kind'], int(row['count']), row['contestant']) for row in read('scaling.csv')}
        self.assertLessEqual(sizes, {(kind, count, each.name) for kind in STUDIES['sizes'].scenes
                                     for count in STUDIES['sizes'].counts
                                     for each in STUDIES['sizes'].methods
                                     if studies.runs(STUDIES['sizes'], kind, each.name)})
        self.assertEqual({size[:2] for size in sizes}, {(kind, count) for kind in STUDIES['sizes'].scenes
                                                        for count in STUDIES['sizes'].counts})

    def test_the_summary_comes_out_to_the_byte(self):
        text = (REPORT / 'summary.md').read_text()
        facts = dict(re.findall('^- (processor|system|compiler|commit): (.*)$', text, re.M))
        run = CONDITIONS.search(text)
        facts.update(absent=[], kind=run['kind'], rounds=int(run['rounds']), budget=float(run['budget']),
                     grid_budget=float(run['grid']), many_budget=float(run['many']),
                     sizes_budget=float(run['sizes']), **{'measured in': run['taken']})
        variants = [cells.Variant(None, '', '', '', *engine.split(' ', 1), [])
                    for engine in run['engines'].split(', ')]
        sizes = [{**row, **{name: float(row[name]) for name in ('time', 'bytes', 'instructions')},
                  'count': int(row['count'])} for row in read('scaling.csv')]
        rows = {part: [row for row in read(f'{name}.csv') if self.is_asked_for(part, row)]
                for part, name in (('diagrams', 'cells'), ('grid', 'grid'), ('many', 'many'))}
        own_errors = {row['problem']: float(row['own_error']) for row in read('references.csv')}
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(pages, 'plots'):
            output = pathlib.Path(folder)
            pages.write(output, rows, sizes, self.problems, variants, own_errors, facts)
            for name in ('summary.md', 'grid.html', 'columns.md'):
                self.assertEqual((output / name).read_text(), (REPORT / name).read_text(), name)


if __name__ == '__main__':
    PROGRAM = sys.argv.pop(1)
    unittest.main()
