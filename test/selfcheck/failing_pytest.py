"""Fails on purpose and is no test: scripts/test shows with it that a failure would be seen."""
import pytest


def test_passes():
    pass


def test_fails():
    assert False


@pytest.mark.skip
def test_is_skipped():
    pass
