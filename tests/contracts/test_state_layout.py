"""Where each state is stands in `estimator/filter/layout.py` alone: no module that imports the filter spells it."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LAYOUT = ROOT / "estimator" / "filter" / "layout.py"
FOLDERS = ("sinan", "sensors", "estimator", "calibration", "experiments", "tests")
#: Bounds of blocks of the error state and of the nominal one.
BLOCKS = "3:6|6:9|6:10|9:12|10:13|10:16|12:15|13:16"
SPELLED = re.compile(rf"\[(?:[^\]\n]*[\s,])?(?:{BLOCKS})[\],]")
#: Of what is a state or its covariance by its name, any bound.
OF_A_STATE = re.compile(r"\b(?:imu_x|x_end|imu_var|P_end|flown\.x)\[(?:[^\]\n]*[\s,])?(?:\d*:\d+|\d+:)[\],]")


def test_only_the_layout_says_where_a_state_is() -> None:
    spelled, own = [], Path(__file__)
    for path in (path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        about_the_filter = "estimator.filter" in text or LAYOUT.parent in path.parents
        if about_the_filter and path not in (LAYOUT, own) and not path.name.endswith("_numba.py"):
            lines = (line for line in text.splitlines() if SPELLED.search(line) or OF_A_STATE.search(line))
            spelled += [f"{path.relative_to(ROOT)}: {line.strip()}" for line in lines]
    assert not spelled, "name them as layout.py does (P_N, V_N, Q_NB, DTHETA): " + "\n".join(spelled)


def test_spelled_slices_are_seen() -> None:
    for line in ("x[6:10]", "x[:, 3:6]", "P[6:9, 6:9]", "journal.imu_x[-1, :3]", "journal.x_end[:6]"):
        assert SPELLED.search(line) or OF_A_STATE.search(line), line
    for line in ("imu_x[::10]", "imu_x[-1]", "row[:3]", 'text("16:10")', "path[1:3]"):
        assert SPELLED.search(line) is OF_A_STATE.search(line) is None, line
