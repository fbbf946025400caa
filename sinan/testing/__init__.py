"""Assertions for regression tests of models: of a Jacobian, of a filter's consistency, of a journal.

A pytest plugin (`sinan.testing.plugin`) keeps journals as text: the fixture `journal_regression`, `--sinan-update`.
"""

from sinan.testing.consistency import assert_consistent
from sinan.testing.jacobians import assert_jacobian, some_motion
from sinan.testing.journals import Bounds, assert_journal_equal, journal_text

__all__ = ["Bounds", "assert_consistent", "assert_jacobian", "assert_journal_equal", "journal_text", "some_motion"]
