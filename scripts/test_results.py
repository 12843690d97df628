#!/usr/bin/env python3
"""Counts the test cases that passed and failed, each once, and exits with 1 when any failed.

  test_results.py REGISTERED RESULTS [CHECK...]

REGISTERED  the build's registered_tests.txt: `kind<tab>name<tab>path` a line. A `gtest` is a program
            and its cases are what it lists; a `rostest` is a .test file and its cases are the
            test_ methods of the scripts it runs, which lie beside it; a `python` is a file for
            pytest and its cases are its test_ functions.
RESULTS     folder with, of each of them, NAME.status (exit status) and the results: NAME.PART.xml of a
            gtest, NAME.xml of a python, NAME/constraint_sim/rosunit-*.xml of a rostest.
CHECK       name of a check made elsewhere that passed; counts as one case.

A registered case without a result failed, whatever the reason: it crashed, timed out, was skipped or
filtered out. A program that fails with all its cases passed counts as one more failed case.
"""
import ast
import pathlib
import subprocess
import sys
import xml.etree.ElementTree


def gtest_cases(program):
    """Names of all cases in a gtest program; DISABLED_ ones are not meant to run."""
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


def rostest_cases(script):
    """Names of the test_ methods in a Python script."""
    classes = [node for node in ast.parse(script.read_text()).body
               if isinstance(node, ast.ClassDef)]
    return {f'{node.name}.{method.name}' for node in classes for method in node.body
            if isinstance(method, ast.FunctionDef) and method.name.startswith('test')}


def python_cases(script):
    """Names of the test_ functions in a Python script, as pytest reports them."""
    path = pathlib.Path(script)
    return {f'{path.stem}.{node.name}' for node in ast.parse(path.read_text()).body
            if isinstance(node, ast.FunctionDef) and node.name.startswith('test')}


def outcomes(path):
    """Case name -> message, empty where it passed. No file or half a one: no cases."""
    try:
        cases = xml.etree.ElementTree.parse(path).iter('testcase')
    except (OSError, xml.etree.ElementTree.ParseError):
        return {}
    found = {}
    for case in cases:
        if case.get('status', 'run') != 'run' or case.find('skipped') is not None:
            continue
        name = case.get('classname').split('__main__.')[-1] + '.' + case.get('name')
        problems = [problem.get('message') or problem.text or 'failed' for problem in case
                    if problem.tag in ('failure', 'error')]
        found[name] = '\n'.join(problems)
    return found


def suite_outcomes(kind, name, path, results):
    """Case name -> message for all registered cases of one gtest program or .test file."""
    if kind == 'gtest':
        registered, found = gtest_cases(path), {}
        for part in sorted(results.glob(f'{name}.*.xml')):
            found.update(outcomes(part))
    elif kind == 'python':
        registered = python_cases(path)
        found = {'.'.join(case.split('.')[-2:]): message
                 for case, message in outcomes(results / f'{name}.xml').items()}
    else:
        registered, found = set(), {}
        for test in xml.etree.ElementTree.parse(path).iter('test'):
            title = test.get('test-name')
            registered |= {f'{title}/{case}' for case in
                           rostest_cases(pathlib.Path(path).parent / test.get('type'))}
            result = outcomes(results / name / 'constraint_sim' / f'rosunit-{title}.xml')
            found.update({f'{title}/{case}': message for case, message in result.items()})
    if not registered:
        found['registration'] = 'no test case is registered'
    return {**{case: 'did not run' for case in registered}, **found}


def main(registered, results, *checks):
    results = pathlib.Path(results)
    passed, failed = len(checks), 0
    for check in checks:
        print(f'{check}: passed')
    for line in pathlib.Path(registered).read_text().splitlines():
        kind, name, path = line.split('\t')
        cases = suite_outcomes(kind, name, path, results)
        status_file = results / f'{name}.status'
        status = status_file.read_text().strip() if status_file.exists() else 'unknown'
        if status != '0' and not any(cases.values()):
            cases['exit status'] = f'{status}, though all cases passed'
        bad = {case: message for case, message in cases.items() if message}
        print(f'{kind} {name}: {len(cases) - len(bad)} passed, {len(bad)} failed')
        for case, message in bad.items():
            print(f'  FAILED {case}: ' + message.strip().replace('\n', '\n    '))
        passed += len(cases) - len(bad)
        failed += len(bad)
    print(f'{passed} passed, {failed} failed')
    return 1 if failed or not passed else 0


if __name__ == '__main__':
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
