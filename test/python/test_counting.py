"""scripts/count_tests.py detects a case that failed, one that was skipped, one that did not run, and a
crash."""
import pathlib
import stat
import subprocess

import pytest

COUNT = pathlib.Path(__file__).resolve().parents[2] / 'scripts' / 'count_tests.py'
PASSED = '<testcase classname="A" name="passes" status="run"/>'
FAILED = '<testcase classname="A" name="fails" status="run"><failure message="2 is not 3"/></testcase>'
SKIPPED = '<testcase classname="A" name="waits"><skipped/></testcase>'


def count(build, cases, listed=(), status=0):
    results = build / 'test_results'
    results.mkdir()
    (results / 'some.xml').write_text('<testsuites><testsuite>%s</testsuite></testsuites>' % ''.join(cases))
    program = build / 'some_tests'
    program.write_text('#!/bin/sh\nprintf "A.\\n"\n' + ''.join('printf "  %s\\n"\n' % case for case in listed))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    done = subprocess.run([COUNT, build, str(status)], stdout=subprocess.PIPE, universal_newlines=True)
    return done.returncode, done.stdout.splitlines()[-1]


@pytest.mark.parametrize('cases, listed, status, expected', [
    ([PASSED], ['passes'], 0, (0, '1 passed, 0 failed')),
    ([PASSED, FAILED], ['passes', 'fails'], 8, (1, '1 passed, 1 failed')),
    ([PASSED, SKIPPED], ['passes'], 0, (1, '1 passed, 1 failed')),
    ([PASSED], ['passes', 'never_ran'], 0, (1, '1 passed, 1 failed')),
    ([PASSED], ['passes'], 8, (1, '1 passed, 1 failed')),
    ([], [], 0, (1, '0 passed, 0 failed')),
])
def test_what_did_not_pass_is_counted(tmp_path, cases, listed, status, expected):
    assert count(tmp_path, cases, listed, status) == expected
