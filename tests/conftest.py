"""Shared fixtures: where the measured data are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def _measured_root() -> Path | None:
    named = os.environ.get("SINAN_DATA")
    for candidate in [Path(named)] if named else [ROOT.parent / "shared" / "data"]:
        if (candidate / "rfly_course").is_dir():
            return candidate
    return None


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Root folder of the measured data sets, or skip."""
    root = _measured_root()
    if root is None:
        pytest.skip("no measured data: set SINAN_DATA or run `sinan fetch`")
    return root
