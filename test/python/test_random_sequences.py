"""Runs some of the sequences that random_sequences.py runs by the thousand."""
import random_sequences


def test_random_sequences():
    assert random_sequences.run(first=0, count=60) == 60


def test_a_finding_is_one(monkeypatch):
    """A world that forgets its energy is found."""
    class Forgetful(random_sequences.engine.World):
        energy = float('nan')

    monkeypatch.setattr(random_sequences.engine, 'World', Forgetful)
    try:
        random_sequences.run(first=0, count=3)
    except random_sequences.Finding as finding:
        assert 'seed 0: the energy is not finite' in str(finding)
    else:
        raise AssertionError('nothing was found')
