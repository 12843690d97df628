"""constraint_sim_sweep: runs the cases of a study and says what came of them."""
import argparse
import os
import pathlib
import signal
import sys

from . import executors, pages, peers, study as studies, tables
from .program import identity
from .progress import Progress
from .report import report_study
from .store import Store, StoreError

BAD_INPUT, CASES_FAILED, INTERRUPTED = 2, 3, 130


def arguments(words):
    parser = argparse.ArgumentParser(
        prog='constraint_sim_sweep', description=__doc__,
        epilog='Exit status: 0; 2 for a study that cannot be; 3 when cases crashed, hung, failed, were too '
               'slow or are missing; 130 when interrupted: the same command goes on from there.')
    parser.add_argument('study', metavar='STUDY.yaml', help='a study (docs/sweeps.md), or with --report a scene')
    parser.add_argument('--output', metavar='FOLDER', help='for results; default: STUDY.results beside the study')
    parser.add_argument('--on', choices=('cluster', 'threads'), default='cluster',
                        help='a local Dask cluster with processes for the cases (default), or threads of '
                             'this process')
    parser.add_argument('--cluster', metavar='ADDRESS', help='the scheduler of a Dask cluster, as tcp://host:8786')
    parser.add_argument('--workers', type=int, default=os.cpu_count(),
                        help='cases at a time on this machine; default: its cores')
    parser.add_argument('--check', action='store_true', help='say what would be run, and run nothing')
    parser.add_argument('--scene', type=int, metavar='CASE', help='print the scene of this case, and run nothing')
    parser.add_argument('--fresh', action='store_true', help='forget what is in the folder')
    parser.add_argument('--no-plots', action='store_true', help='write tables and the summary without plots')
    parser.add_argument('--peers', metavar='FOLDER',
                        help='with the programs of the report (constraint_sim_report_*): methods may be those of '
                             'other engines')
    parser.add_argument('--report', action='store_true',
                        help='the argument is a scene: error against run time and stability of all methods')
    parser.add_argument('--duration', type=float, default=5.0, help='of --report [s]; default: 5')
    return parser.parse_args(words)


def print_scene(study, wanted):
    first = 0
    for scene, values in study.points():
        for case in study.cases_at(first, scene, values):
            if case.index == wanted:
                print(study.text_of(case), end='')
                return
            first = case.index + 1
    raise studies.StudyError(f'--scene: there is no case {wanted}; there are 0 to {first - 1}')


def check(study):
    """All jobs, and (case, key, bodies) of each case; every scene has been loaded."""
    progress = Progress('checking', study.count())
    jobs, entries = [], []
    for job, cases in study.jobs(identity(), progress.step):
        jobs.append(job)
        entries += [(case, entry['key'], entry['bodies']) for case, entry in zip(cases, job['cases'])]
    progress.close()
    return jobs, entries


def left_of(jobs, store):
    """Jobs without the cases that are done."""
    left = []
    for job in jobs:
        cases = [case for case in job['cases'] if case['key'] not in store.results]
        if cases:
            # run times of a group are only compared with those of the same round of runs
            left.append({**job, 'cases': job['cases'] if job['rounds'] > 1 else cases})
    return left


def run(study, jobs, store, options):
    left = left_of(jobs, store)
    if not left:
        return
    wanted = {case['key'] for job in left for case in job['cases']}
    progress = Progress('cases', len(wanted))
    found = executors.on_threads(left, study.filled, options.workers) if options.on == 'threads' and not options.cluster \
        else executors.on_cluster(left, study.filled, options.workers, options.cluster, study.memory)
    try:
        for results in found:
            store.add(results)
            progress.step(len(wanted & set(results)))
            wanted -= set(results)
    finally:
        found.close()
        progress.close()


def sweep(options):
    if options.workers < 1:
        raise studies.StudyError(f'--workers: must be at least 1, got {options.workers}')
    path = pathlib.Path(options.study)
    found = peers.found_in(options.peers) if options.peers else {}
    if options.peers and not found:
        raise studies.StudyError(f'--peers: no program constraint_sim_report_* in {options.peers}')
    if options.peers and options.cluster:
        raise studies.StudyError('--peers: their programs are on this machine, not on those of --cluster')
    study = report_study(path, options.duration, found) if options.report else studies.load(path, found)
    if options.scene is not None:
        print_scene(study, options.scene)
        return 0
    jobs, entries = check(study)
    if options.check:
        print(f'{len(entries)} cases in {len(jobs)} groups, {study.rounds} rounds, program {identity()}')
        return 0
    folder = pathlib.Path(options.output or path.with_suffix('.results'))
    store = Store(folder, options.fresh)
    try:
        run(study, jobs, store, options)
        table = tables.rows(study, [entry[:2] for entry in entries], store.results)
        written = tables.write(folder, 'results', table)
        if study.keeps_samples:
            tables.write(folder, 'samples', list(tables.sample_rows(entries, store)))
        missing = len(entries) - len(table)
        lines = pages.write(folder, study, table, missing, plots=not options.no_plots)
    finally:
        store.close()
    print('\n'.join(lines))
    print(f'{written}, {folder}/index.html')
    return CASES_FAILED if missing or any(row['outcome'] not in ('ok', 'unsupported') for row in table) else 0


def main(words=None):
    options = arguments(words)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return sweep(options)
    except studies.StudyError as error:
        print(f'constraint_sim_sweep: {options.study}: {error}', file=sys.stderr)
        return BAD_INPUT
    except (StoreError, OSError, RuntimeError) as error:
        print(f'constraint_sim_sweep: {error}', file=sys.stderr)
        return CASES_FAILED
    except KeyboardInterrupt:
        print('\nconstraint_sim_sweep: interrupted; the same command goes on from here', file=sys.stderr)
        return INTERRUPTED
