"""constraint_sim_sweep: runs the cases of a study and says what came of them."""
import argparse
import collections
import os
import pathlib
import signal
import sys

from . import executors, pages, peers, report, study as studies, tables
from .program import identity
from .progress import CaseProgress, Progress
from .store import RESULTS, Store, StoreError

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


def print_scene(all_studies, wanted):
    first = 0
    for study in all_studies:
        for scene, values in study.points():
            for case in study.cases_at(first, scene, values):
                if case.index == wanted:
                    print(study.text_of(case), end='')
                    return
                first = case.index + 1
    raise studies.StudyError(f'--scene: there is no case {wanted}; there are 0 to {first - 1}')


Checked = collections.namedtuple('Checked', 'study jobs entries')  # entries: (case, key, bodies) of each case


def check(all_studies):
    """All jobs of each; every scene has been loaded."""
    progress = Progress('checking', sum(study.count() for study in all_studies))
    found = []
    for study in all_studies:
        jobs, entries = [], []
        for job, cases in study.jobs(identity(), progress.step):
            jobs.append(job)
            entries += [(case, entry['key'], entry['bodies']) for case, entry in zip(cases, job['cases'])]
        found.append(Checked(study, jobs, entries))
    progress.close()
    return found


def left_of(jobs, store):
    """Jobs without the cases that are done."""
    left = []
    for job in jobs:
        cases = [case for case in job['cases'] if case['key'] not in store.results]
        if cases:
            # run times of a group are only compared with those of the same round of runs
            left.append({**job, 'cases': job['cases'] if job['rounds'] > 1 else cases})
    return left


def run_all(checked, store, options):
    left = [(each.study, left_of(each.jobs, store)) for each in checked]
    progress = CaseProgress('cases', [case['key'] for _, jobs in left for job in jobs for case in job['cases']])
    try:
        for study, jobs in left:
            if jobs:
                run(study, jobs, store, options, progress)
    finally:
        progress.close()


def run(study, left, store, options, progress):
    if options.on == 'threads' and not options.cluster:
        found = executors.on_threads(left, study.filled, options.workers, progress.reached)
    else:
        found = executors.on_cluster(left, study.filled, options.workers, options.cluster, study.memory,
                                     progress.reached)
    try:
        for results in found:
            store.add(results)
            progress.reached(dict.fromkeys(results, 1.0))
    finally:
        found.close()


def sweep(options):
    if options.workers < 1:
        raise studies.StudyError(f'--workers: must be at least 1, got {options.workers}')
    path = pathlib.Path(options.study)
    found = peers.found_in(options.peers) if options.peers else {}
    if options.peers and not found:
        raise studies.StudyError(f'--peers: no program constraint_sim_report_* in {options.peers}')
    reported = report.studies_of(path, options.duration, found) if options.report else None
    all_studies = [reported.diagram, *reported.grid] if reported else [studies.load(path, found)]
    if options.cluster and any(study.peer_of for study in all_studies):
        raise studies.StudyError('--cluster: the programs of peers are on this machine, not on those of the cluster')
    if options.scene is not None:
        print_scene(all_studies, options.scene)
        return 0
    checked = check(all_studies)
    if options.check:
        cases, groups = (sum(map(len, each)) for each in zip(*((each.entries, each.jobs) for each in checked)))
        print(f'{cases} cases in {groups} groups, '
              f'{all_studies[0].rounds} rounds, program {identity()}')
        return 0
    folder = pathlib.Path(options.output or path.with_suffix('.results'))
    refuse_what_others_wrote(folder)
    store = Store(folder, options.fresh)
    try:
        run_all(checked, store, options)
        found = [tables.rows(each.study, [entry[:2] for entry in each.entries], store.results) for each in checked]
        written = tables.write(folder, 'results', found[0])
        if all_studies[0].keeps_samples:
            tables.write(folder, 'samples', list(tables.sample_rows(checked[0].entries, store)))
        missing = sum(len(each.entries) for each in checked) - sum(map(len, found))
        if reported:
            tables.write(folder, 'stability', [row for table in found[1:] for row in table])
            lines = report.write(folder, reported, found, missing, identity(), plots=not options.no_plots)
        else:
            lines = pages.write(folder, all_studies[0], found[0], missing, plots=not options.no_plots)
    finally:
        store.close()
    print('\n'.join(lines))
    print(f'{written}, {folder}/index.html')
    is_bad = any(row['outcome'] not in ('ok', 'unsupported') for table in found for row in table)
    return CASES_FAILED if missing or is_bad else 0


def refuse_what_others_wrote(folder):
    if folder.exists() and not (folder / RESULTS).exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise studies.StudyError(f'--output: {folder} is there and no sweep wrote it; name another folder')


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
