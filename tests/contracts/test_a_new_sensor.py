"""A sonar with three beams: the differences of docs/how_to_add_a_sensor.md, applied as they stand there, and flown."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "how_to_add_a_sensor.md"
PARTS = ("sinan", "sensors", "estimator", "calibration", "experiments")
SCENARIO = """like = "figure_eight"
[sensors.sonar]
angles = [-0.4, 0.0, 0.4]
[[manoeuvre]]
kind = "hold"
duration = 2.0
[[manoeuvre]]
kind = "leg"
north = 6.0
east = 4.0
duration = 4.0
"""
FLOWN = """
import sys
from pathlib import Path
import numpy as np
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.formats.plain import read_recording, write_recording
from sinan.sensors.simulate import simulate
write_recording(simulate(load_scenario(Path("three.toml")), np.random.default_rng(1))[0], Path("three"))
recording = read_recording(Path("three"))
sonar = run_filter(recording, flight_model(recording), engine="filterpy").stream("sonar")
print(*sonar.nu.shape, np.mean(sonar.nis) / 3)
"""


def test_a_sonar_with_three_beams_is_what_the_guide_says(tmp_path: Path) -> None:
    for part in PARTS:
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"))
    differences = re.findall(r"```diff\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    subprocess.run(["git", "apply", "-"], input="".join(differences), cwd=tmp_path, text=True, check=True)
    (tmp_path / "three.toml").write_text(SCENARIO, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", FLOWN], cwd=tmp_path, env=environment, text=True, capture_output=True, check=True
    )
    readings, beams, nis = done.stdout.split()
    assert (int(readings) > 100, int(beams)) == (True, 3)
    assert 0.8 < float(nis) < 1.2  # 360 squares: 0.075 is one sigma
