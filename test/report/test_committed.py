#!/usr/bin/env python3
"""Checks the committed report, docs/report: its page and pictures follow from the committed figures to the byte, and
the figures are of problems, methods and time steps that exist.

test_committed.py PROGRAM, where PROGRAM is constraint_sim_report_engine, which knows the problems.
"""
import math
import pathlib
import re
import shutil
import sys
import tempfile
import unittest

PACKAGE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / 'bench' / 'report'))
import cells  # noqa: E402
import kinds  # noqa: E402
import pages  # noqa: E402
import report  # noqa: E402
import stored  # noqa: E402
import studies  # noqa: E402

REPORT = PACKAGE / 'docs' / 'report'
STUDIES = report.STUDIES


class Committed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.problems = cells.problems(PROGRAM)
        cls.figures = stored.read(REPORT / 'data')

    def test_the_page_and_its_pictures_come_out_to_the_byte(self):
        with tempfile.TemporaryDirectory() as folder:
            output = pathlib.Path(folder)
            shutil.copy(REPORT / 'scenes.svg', output)  # drawn from scenes, which are no figures
            pages.write(output, self.figures)
            written = {path.name: path.read_bytes() for path in output.iterdir()}
        committed = {path.name: path.read_bytes() for path in REPORT.iterdir()
                     if path.is_file() and path.name != 'random.md'}  # which random_grid.py writes
        self.assertEqual(sorted(written), sorted(committed))
        for name, content in written.items():
            self.assertTrue(content == committed[name], f'{name}: make it again by scripts/report --redraw')

    def test_the_page_shows_each_picture_and_opens_with_ten_lines(self):
        text = (REPORT / 'summary.md').read_text()
        self.assertEqual(sorted(re.findall(r'\]\((\w+\.svg)\)', text)),
                         sorted(path.name for path in REPORT.glob('*.svg')))
        opening = text.split('![')[0]
        self.assertEqual(re.findall(r'^(\d+)\. ', opening, re.M), [str(number) for number in range(1, 11)])

    def test_problems_have_the_kind_and_the_source_that_the_program_says(self):
        for row in self.figures.problems:
            problem = self.problems[row['problem']]
            kind = kinds.kind_of(problem.name, problem.group) if problem.graded else ''
            self.assertEqual((row['kind'], row['source']), (kind, problem.source), problem.name)
        shown = {row['problem'] for row in self.figures.problems}
        self.assertLessEqual({row['problem'] for row in self.figures.fronts + self.figures.stability}, shown)

    def test_methods_of_this_engine_are_those_of_the_program(self):
        known = {cells.label(variant) for variant in cells.variants(pathlib.Path(PROGRAM).parent)}
        for rows in (self.figures.fronts, self.figures.many, self.figures.sizes):
            own = {row['contestant'] for row in rows if row['contestant'].startswith('constraint_sim ')}
            self.assertLessEqual(own, known)

    def test_settings_are_those_of_the_studies(self):
        steps = STUDIES['diagrams'].time_steps
        tolerances = {f'{value:.6g}' for variant in cells.variants(pathlib.Path(PROGRAM).parent)
                      for value in variant.values}
        for row in self.figures.fronts:
            if row['contestant'].startswith('constraint_sim '):
                self.assertTrue(row['value'] in tolerances or
                                any(math.isclose(float(row['value']), step, rel_tol=1e-5) for step in steps), row)
        for row in self.figures.sizes:
            self.assertIn(int(row['count']), STUDIES['sizes'].counts)
            self.assertTrue(studies.runs(STUDIES['sizes'], row['kind'], row['contestant']), row)


if __name__ == '__main__':
    PROGRAM = sys.argv.pop(1)
    unittest.main()
