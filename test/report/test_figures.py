#!/usr/bin/env python3
"""Evaluation of the report's figures, against results worked out by hand."""
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / 'bench' / 'report'))
import package_path  # noqa: E402, F401
from constraint_sim.sweep import figures  # noqa: E402
import cells  # noqa: E402
import kinds  # noqa: E402
import pages  # noqa: E402
import published  # noqa: E402
import report  # noqa: E402
import stored  # noqa: E402


def row(**values):
    line = dict.fromkeys(cells.COLUMNS, 'nan')
    line.update({'round': '1', 'problem': 'p', 'contestant': 'constraint_sim a', 'value': '0.1',
                 'outcome': 'ok', 'run_time': '10'})
    line.update(values)
    return line


def problem(**values):
    return cells.Problem('p', 'g', True, 2.0, 2.0, 1.0, False, False, True, '')._replace(**values)


def facts(**values):
    return {'commit': 'abc', 'date': '2026-01-01', 'size': 'full', 'covers': '', 'minutes': 1.0, 'rounds': 2, 'noise': 2.0,
            'budgets': {'diagrams': 0.1}, 'time_steps': [0.2, 1e-5], 'engines': {'ode': '1'}, 'absent': [],
            'processor': 'p', 'system': 's', 'compiler': 'c', 'spread': [0.1, 0.2], **values}


class Contenders(unittest.TestCase):
    """Which runs of the first round later rounds repeat."""

    def setUp(self):
        self.rows = [row(position='1e-3', orientation='0', value='0.1', run_time='10'),
                     row(position='1e-2', orientation='0', value='0.2', run_time='15'),
                     row(position='1e-3', orientation='0', value='0.05', run_time='21'),
                     row(position='1e-4', orientation='0', value='0.02', run_time='50'),
                     row(position='1e-2', orientation='0', value='0.1', run_time='21', contestant='constraint_sim b'),
                     row(position='1e-2', orientation='0', value='0.1', run_time='99', contestant='ode a'),
                     row(position='1e-9', orientation='0', value='1', run_time='1', outcome='not_finite'),
                     row(position='1e-9', orientation='0', value='1', run_time='1',
                         contestant='constraint_sim a perturbed')]

    def test_what_its_engine_beats_by_the_noise_is_not_repeated(self):
        self.assertEqual(figures.contenders(self.rows, 2.0),
                         {('p', 'constraint_sim a'): [0.2, 0.1, 0.02], ('p', 'ode a'): [0.1]})

    def test_without_a_limit_all_that_succeeded_is_repeated(self):
        self.assertEqual(figures.contenders(self.rows),
                         {('p', 'constraint_sim a'): [0.2, 0.1, 0.05, 0.02], ('p', 'constraint_sim b'): [0.1],
                          ('p', 'ode a'): [0.1]})


class Script(unittest.TestCase):
    """Runs scripts/report in a package that measures nothing and only prints its arguments."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.package = pathlib.Path(folder.name)
        sources = pathlib.Path(__file__).resolve().parents[2]
        for name in ('scripts', 'bench/report', 'docs/report'):
            (self.package / name).mkdir(parents=True)
        shutil.copy(sources / 'scripts/report', self.package / 'scripts/report')
        (self.package / 'scripts/setup').write_text('#!/bin/sh\n')
        os.chmod(self.package / 'scripts/setup', 0o755)
        (self.package / 'bench/report/report.py').write_text('import sys\nprint(*sys.argv[1:])\n')
        (self.package / 'CMakeLists.txt').write_text(
            'cmake_minimum_required(VERSION 3.16)\nproject(nothing NONE)\n'
            'add_custom_target(report_programs)\n')

    def said(self, *options):
        return subprocess.run([self.package / 'scripts/report', *options], text=True, check=True,
                              stdout=subprocess.PIPE).stdout

    def folders_of(self, *options):
        """Returns the folder of the report, and that of the page or None."""
        said = self.said(*options).split()
        self.assertNotIn('--update', said)
        return said[said.index('--output') + 1], said[said.index('--page') + 1] if '--page' in said else None

    def test_the_committed_page_stays_unless_it_is_to_be_updated(self):
        self.assertEqual(self.folders_of(), ('build/report/full', None))
        self.assertEqual(self.folders_of('--quick'), ('build/report/quick', None))
        self.assertEqual(self.folders_of('--budget', '0.15', '--update'), ('build/report/full', 'docs/report'))
        self.assertEqual(self.folders_of('--quick', '--update'), ('build/report/quick', 'docs/report'))

    def test_it_says_how_long_it_took(self):
        self.assertRegex(self.said(), r'report: took \d+ minutes, \d+ of them to build\n$')

    def test_drawing_the_page_again_measures_nothing(self):
        self.assertEqual(self.said('--redraw'), '--redraw docs/report\n')


class Figures(unittest.TestCase):
    def test_the_best_round_counts(self):
        runs = figures.runs_of([row(round='1', run_time='12', position='1e-3'),
                                row(round='2', run_time='10', position='1e-3')])
        run, = runs['p']['constraint_sim a']
        self.assertEqual(run.time, 10.0)
        self.assertAlmostEqual(run.spread, 0.1)  # median 11 over 10

    def test_one_round_tells_no_spread(self):
        once = figures.runs_of([row(round='1')])
        self.assertTrue(math.isnan(figures.spread(once)[0]))
        twice = figures.runs_of([row(round='1', run_time='12'), row(round='2', run_time='10')])
        self.assertAlmostEqual(figures.spread(twice)[0], 0.1)
        self.assertIn('too few to tell', pages.conditions_of(facts(spread=[None, None]))[5])
        self.assertIn('above it by 10 % (median of all settings), at most 20 %',
                      pages.conditions_of(facts(spread=[0.1, 0.2]))[5])

    def test_the_cheapest_run_below_the_target_counts(self):
        rows = [row(value='0.1', run_time='10', position='1e-3'),
                row(value='0.05', run_time='20', position='1e-5'),
                row(value='0.01', run_time='90', position='1e-8'),
                row(contestant='peer x', value='0.05', run_time='300', position='2e-5'),
                row(contestant='peer y', value='0.05', run_time='200', position='1e-2'),
                row(contestant='peer z', value='0.05', run_time='1', position='0',
                    outcome='too_slow')]
        lines = {line[1]: line for line in figures.comparison(figures.runs_of(rows))}
        self.assertEqual(lines[1e-4][2][1].time, 20.0)
        self.assertEqual(lines[1e-4][3][0], 'peer x')
        self.assertAlmostEqual(lines[1e-4][4], 15.0)
        self.assertAlmostEqual(lines[1e-2][4], 20.0)  # y is the cheaper peer there
        self.assertIsNone(lines[1e-6][3])
        self.assertIsNone(lines[1e-9][2])

    def test_a_peer_that_wins_has_a_ratio_below_one(self):
        rows = [row(run_time='10', position='1e-5'),
                row(contestant='peer x', run_time='5', position='1e-5')]
        ratio = [line[4] for line in figures.comparison(figures.runs_of(rows)) if line[1] == 1e-4]
        self.assertEqual(ratio, [0.5])

    def test_the_front_has_what_nothing_beats_in_both(self):
        points = [(1.0, 1e-1), (2.0, 1e-3), (3.0, 1e-2), (4.0, 1e-3), (5.0, 1e-6)]
        self.assertEqual(figures.pareto(points), [(1.0, 1e-1), (2.0, 1e-3), (5.0, 1e-6)])

    def test_slope(self):
        self.assertAlmostEqual(figures.slope([10, 100, 1000], [3.0, 300.0, 30000.0]), 2.0)

    def test_scaling_of_a_tick(self):
        rows = [row(problem=f'links_{count}', round=str(number), value='0.001',
                    run_time=str(time), memory='5e3')
                for count, times in ((10, (4000, 3000)), (1000, (300000, 310000)))
                for number, time in enumerate(times, 1)]
        rows.append(row(problem='links_10', contestant='peer x', value='0.001', outcome='crashed',
                        run_time='nan'))
        sizes = figures.scaling(figures.runs_of(rows), {'constraint_sim a links_10': 7})
        self.assertEqual([(line['contestant'], line['count'], line['instructions'])
                          for line in sizes[:1]], [('constraint_sim a', 10, 7)])
        lines = figures.growth(sizes, 'time')  # 3000 µs/s in ticks of 1 ms
        self.assertEqual(list(lines), [('links', 'constraint_sim a')])
        (_, first), (_, last) = lines['links', 'constraint_sim a']
        self.assertAlmostEqual(first, 3.0)
        self.assertAlmostEqual(last, 300.0)
        slope, = (line for line in pages.slope_lines(sizes))
        self.assertEqual(slope[:5], ['links', 'constraint_sim a', '10 to 1000', '1.00', '0.3'])

    def test_a_run_that_was_too_slow_has_the_time_of_its_part(self):
        runs = figures.runs_of([row(outcome='too_slow', run_time='95e6', constraint='0.1')])
        self.assertEqual(runs['p']['constraint_sim a'][0].time, 95e6)
        self.assertIsNone(figures.time_to(runs['p']['constraint_sim a'], 1.0))

    def test_classes_of_the_grid(self):
        # the scene is 2 m large
        for expected, values in {
                'exact': {'position': '1.9e-6', 'energy': '0.5'},
                'stable': {'position': '1e-3', 'energy': '1e-3', 'constraint': '1e-3'},
                'drifting': {'position': '1e-3', 'energy': '0.02', 'constraint': '1e-3'},
                'stretched': {'position': '1e-1', 'energy': '0.02', 'constraint': '0.021'},
                'refused': {'outcome': 'refused'}, 'crashed': {'outcome': 'crashed'},
                'too slow': {'outcome': 'hung'}, 'n/a': {'outcome': 'unsupported'}}.items():
            self.assertEqual(figures.verdict(row(**values), problem())[0], expected, values)
        for values in ({'outcome': 'not_finite'}, {'position': '20.1'},
                       {'position': '1e-9', 'energy': '10.1'},
                       {'distance': '20.1'}):  # without a reference: from the start position
            self.assertEqual(figures.verdict(row(**values), problem())[0], 'exploded', values)
        # without a reference nothing is exact, and with a conflict the joints' error is meaningless
        self.assertEqual(figures.verdict(row(energy='0'), problem())[0], 'stable')
        self.assertEqual(figures.verdict(row(position='1e-3', constraint='1'),
                                         problem(conflict=True))[0], 'stable')
        self.assertEqual(figures.verdict(row(outcome='refused'), problem(invalid=True))[0], 'exact')
        self.assertEqual(figures.verdict(row(position='0'), problem(invalid=True))[0], 'exploded')

    def test_what_a_run_is_judged_by(self):
        def errors(**values):
            return {**dict.fromkeys(figures.MEASURES, math.nan), **values}
        self.assertEqual(figures.judged(errors(position=1.0, orientation=2.0, constraint=9.0)), 2.0)
        self.assertEqual(figures.judged(errors(position=1.0, energy=9.0)), 1.0)
        self.assertEqual(figures.judged(errors(constraint=3.0, penetration=4.0)), 4.0)
        self.assertEqual(figures.judged(errors(constraint=1e-9, energy=0.5)), 0.5)
        self.assertTrue(math.isnan(figures.judged(errors())))

    def test_columns_of_the_earlier_comparison_are_found(self):
        named = {published.column(name) for name in (
            'ode step', 'dart joint', 'mujoco joint_rk4', 'mujoco tendon_euler', 'bullet dantzig',
            'bullet featherstone_rk4', 'simbody rod', 'simbody pin')}
        used = {name for columns in published.TIMES.values() for name in columns} - {'simbody'}
        self.assertEqual(named, used)


class Page(unittest.TestCase):
    """The stored figures of the page, and the page."""

    ROWS = [row(problem='gear_pair', value='0.2', run_time='10', position='1e-3'),
            row(problem='gear_pair', value='0.1', run_time='20', position='2e-3'),  # worse in both
            row(problem='gear_pair', value='0.05', run_time='40', position='1e-7'),
            row(problem='gear_pair', contestant='constraint_sim b', run_time='15', position='1e-5'),
            row(problem='gear_pair', contestant='ode step', run_time='5', position='1e-3'),
            row(problem='gear_pair', contestant='ode step', value='0.01', run_time='600', position='1e-5'),
            row(problem='gear_pair', contestant='ode step', value='0.001', outcome='too_slow', position='1e-9'),
            row(problem='gear_pair', contestant='constraint_sim a perturbed', run_time='1', position='0')]

    def page(self):
        runs = figures.runs_of(self.ROWS)
        problems = {'gear_pair': problem(name='gear_pair', group='mechanism')}
        return stored.Stored([facts()], stored.fronts_of(runs), [], [], [],
                             stored.problems_of(problems, {'gear_pair': 1e-12}, {'gear_pair'}))

    def test_of_each_engine_the_runs_are_kept_that_no_other_beats(self):
        self.assertEqual([(each['contestant'], each['run_time'], each['error']) for each in self.page().fronts],
                         [('constraint_sim a', '10', '0.001'), ('constraint_sim b', '15', '1e-05'),
                          ('constraint_sim a', '40', '1e-07'), ('ode step', '5', '0.001'),
                          ('ode step', '600', '1e-05')])

    def test_ratios_of_all_runs_and_of_the_kept_ones_are_equal(self):
        def ratios(runs):
            return str([(line[:2], line[4]) for line in figures.comparison(runs)])  # as text, nan equals nan
        self.assertEqual(ratios(stored.runs_of(self.page().fronts)), ratios(figures.runs_of(self.ROWS)))

    def test_stored_figures_are_read_as_they_were_written(self):
        with tempfile.TemporaryDirectory() as folder:
            first, second = pathlib.Path(folder) / 'first', pathlib.Path(folder) / 'second'
            stored.write(first, self.page())
            stored.write(second, stored.read(first))
            for path in first.iterdir():
                self.assertEqual(path.read_bytes(), (second / path.name).read_bytes(), path.name)

    def test_the_page_says_where_another_engine_is_faster_and_why(self):
        with tempfile.TemporaryDirectory() as folder:
            pages.write(pathlib.Path(folder), self.page())
            text = (pathlib.Path(folder) / 'summary.md').read_text()
        self.assertIn('| Joints and couplings | gear_pair: 0.5 at 1e-2 | ODE | ' +
                      kinds.reason_of('gear_pair', 'mechanisms'), text)
        self.assertIn('constraint_sim is faster in 1 of 1 problems that both reach, at least 10 times in 1; median '
                      'ratio 40', text)
        self.assertIn('Measured at commit abc (2026-01-01) in 1 minutes', text)

    def test_each_problem_has_a_kind(self):
        known = {kind.name for kind in kinds.KINDS}
        for name, group, kind in (('arm_7', 'mechanism', 'robots'), ('gear_pair', 'mechanism', 'mechanisms'),
                                  ('ring_12', 'smooth', 'loops'), ('heavy_chain_1e3', 'stiff', 'loops'),
                                  ('pendulum', 'smooth', 'smooth'), ('winch', 'event', 'events'),
                                  ('rolling', 'contact', 'contacts')):
            self.assertEqual(kinds.kind_of(name, group), kind, name)
            self.assertIn(kind, known)

    def test_time_steps_fit_the_duration(self):
        variant = cells.Variant('', 'v', '', 'tick', 'e', '', [])
        self.assertEqual(report.values_of(variant, problem(duration=2.0), 0.05), [0.2, 0.1, 0.05])
        self.assertEqual(report.values_of(variant, problem(duration=1.5), 0.05), [0.1, 0.05])


class Age(unittest.TestCase):
    """scripts/check_report, in a repository of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.package = pathlib.Path(folder.name)
        for name in ('scripts', 'src/engine', 'docs/report/data'):
            (self.package / name).mkdir(parents=True)
        shutil.copy(pathlib.Path(__file__).resolve().parents[2] / 'scripts/check_report', self.package / 'scripts')
        self.git('init', '-q')
        self.measured = self.change('src/engine/a.cpp')

    def git(self, *arguments):
        return subprocess.run(['git', '-c', 'user.name=n', '-c', 'user.email=e', '-C', self.package, *arguments],
                              check=True, text=True, stdout=subprocess.PIPE).stdout.strip()

    def change(self, name):
        with open(self.package / name, 'a') as file:
            file.write('x')
        self.git('add', '.')
        self.git('commit', '-q', '-m', 'change')
        return self.git('rev-parse', '--short=8', 'HEAD')

    def check(self, *commits):
        (self.package / 'docs/report/data/runs.json').write_text(json.dumps([facts(commit=each) for each in commits]))
        done = subprocess.run([self.package / 'scripts/check_report'], text=True, stdout=subprocess.PIPE)
        return done.returncode, done.stdout

    def test_a_report_may_be_sixty_commits_of_the_engine_old(self):
        for _ in range(60):
            self.change('src/engine/a.cpp')
        self.change('README.md')
        self.assertEqual(self.check(self.measured)[0], 0)
        self.change('src/engine/a.cpp')
        code, said = self.check(self.measured)
        self.assertEqual(code, 1)
        self.assertIn(f'61 commits that touch src/engine came after {self.measured}', said)

    def test_a_report_has_one_commit_that_is_known_and_without_changes_beside_it(self):
        later = self.change('src/engine/a.cpp')
        for commits, message in (((self.measured, later), 'several commits'), (('12345678',), 'is not an ancestor'),
                                 ((f'{later}-dirty',), 'were not committed')):
            code, said = self.check(*commits)
            self.assertEqual(code, 1, said)
            self.assertIn(message, said)


class Processes(unittest.TestCase):
    """An engine may crash or hang: its cell reports that, and other cells are kept."""

    def run_program(self, text, values):
        with tempfile.TemporaryDirectory() as folder:
            program = pathlib.Path(folder) / 'program'
            program.write_text('#!/bin/bash\n' + text)
            program.chmod(0o755)
            variant = cells.Variant(program, 'v', 'joint', 'tick', 'peer', '1', [])
            batch = cells.Batch(1, 'p', variant, values, False)
            grace, cells.GRACE = cells.GRACE, 3.0  # a busy machine starts a shell within this time
            try:
                return cells.run_batch(batch, folder, budget=0.1, repeats=1, perturbation=0.0,
                                       memory=0)
            finally:
                cells.GRACE = grace

    LINE = 'p,peer v,tick,%s,ok,1,1,0,0,0,0,0,0,0,0'
    # replaces a program: its values are the arguments after --values
    LOOP = 'while [ "$1" != --values ]; do shift; done; shift\nfor v; do echo "begin $v"; %s\n' \
        'echo "' + LINE % '$v' + '"; done\n'

    def test_a_crash_costs_one_setting(self):
        rows = self.run_program(self.LOOP % '[ $v != 2 ] || kill -SEGV $$', [1, 2, 3])
        self.assertEqual([line[4:6] for line in rows],
                         [['1', 'ok'], ['2', 'crashed'], ['3', 'ok']])

    def test_what_hangs_is_stopped(self):
        rows = self.run_program(self.LOOP % '[ $v != 2 ] || exec sleep 60', [1, 2, 3])
        self.assertEqual([line[4:6] for line in rows], [['1', 'ok'], ['2', 'hung']])

    def test_rows_have_all_columns(self):
        for row_found in self.run_program(self.LOOP % '[ $v != 2 ] || kill -SEGV $$', [1, 2]):
            self.assertEqual(len(row_found), len(cells.COLUMNS))

    def test_a_program_that_does_not_start_is_an_error(self):
        with self.assertRaises(RuntimeError):
            self.run_program('exit 2', [1])

    def test_a_run_goes_on_as_long_as_what_it_measures_is_the_same(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / 'state.json'
            self.assertFalse(report.is_continued(path, {'commit': 'a'}, {}))
            path.write_text('{"run": {"commit": "a"}, "versions": {"peer": "1"}}')
            self.assertTrue(report.is_continued(path, {'commit': 'a'}, {'peer': '1'}))
            self.assertTrue(report.is_continued(path, {'commit': 'a'}, {'peer': '1', 'new': '1'}))
            self.assertTrue(report.is_continued(path, {'commit': 'a'}, {}))
            self.assertFalse(report.is_continued(path, {'commit': 'a'}, {'peer': '2'}))
            self.assertFalse(report.is_continued(path, {'commit': 'b'}, {'peer': '1'}))

    def test_an_interrupted_run_goes_on(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / 'cells.csv'
            variant = cells.Variant('program', 'v', 'joint', 'tick', 'peer', '1', [])
            done = cells.Batch(1, 'p', variant, [1], False)
            table = cells.Table(path, is_fresh=True)
            table.add(done, [['1', 'p', 'peer v'] + ['0'] * (len(cells.COLUMNS) - 3)])
            again = cells.Table(path, is_fresh=False)
            self.assertTrue(again.has(done))
            self.assertFalse(again.has(done._replace(round=2)))
            self.assertEqual(len(again.rows()), 1)
            self.assertFalse(cells.Table(path, is_fresh=True).has(done))


if __name__ == '__main__':
    unittest.main()
