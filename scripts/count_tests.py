#!/usr/bin/env python3
"""Counts the test cases that passed and failed; fails unless every registered case ran.

  count_tests.py BUILD CTEST_STATUS

BUILD         the build's folder, after CTest ran in it. Results are the XML files that gtest, pytest and
              rostest leave in test_results.
CTEST_STATUS  CTest's exit status: a failure without a failed case, such as a crash, counts as
              one failed case.

Registered are the cases that the gtest programs list. rostest and pytest run what their files define and
fail otherwise, so that for these CTest's status is enough. A skipped case has failed.
"""
import pathlib
import subprocess
import sys
import xml.etree.ElementTree


def listed_cases(program):
    listing = subprocess.run([program, '--gtest_list_tests'], check=True, text=True,
                             stdout=subprocess.PIPE).stdout
    suite, cases = '', set()
    for line in listing.splitlines():
        name = line.split('#')[0].rstrip()
        if not line.startswith(' '):
            suite = name
        elif 'DISABLED_' not in suite + name:
            cases.add(suite + name.strip())
    return cases


def main(build, status):
    results = next(build.rglob('test_results'))
    passed, failed, ran = 0, [], set()
    for path in sorted(results.rglob('*.xml')):
        # rostest writes each result twice: for the test, and for the file that names it
        if path.parent.name == 'constraint_sim' and path.name.startswith('rostest-'):
            continue
        try:
            cases = xml.etree.ElementTree.parse(path).iter('testcase')
        except xml.etree.ElementTree.ParseError:
            failed.append(f'{path.stem}: its result is not whole')
            continue
        for case in cases:
            name = f"{case.get('classname')}.{case.get('name')}"
            ran.add(name)
            if case.get('status') == 'notrun':
                continue
            if any(case.find(tag) is not None for tag in ('failure', 'error', 'skipped')):
                failed.append(f'{path.stem}: {name}')
            else:
                passed += 1
    for program in sorted(build.rglob('*_tests')):
        if program.is_file():
            failed += [f'{program.name}: {case} did not run' for case in sorted(listed_cases(program) - ran)]
    if int(status) and not failed:
        failed.append(f'CTest ended with status {status}, though every case passed')
    for name in failed:
        print(f'FAILED {name}')
    print(f'{passed} passed, {len(failed)} failed')
    return 1 if failed or not passed else 0


if __name__ == '__main__':
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(pathlib.Path(sys.argv[1]), sys.argv[2]))
