#!/usr/bin/env python3
"""Fails on purpose and is no test: scripts/test shows with it that a failure would be seen."""
import unittest

import rostest


class Failing(unittest.TestCase):
    def test_passes(self):
        self.assertEqual(2 * 2, 4)

    def test_fails_on_purpose(self):
        self.assertEqual(2 * 2, 5)


if __name__ == '__main__':
    rostest.rosrun('constraint_sim', 'failing', Failing)
