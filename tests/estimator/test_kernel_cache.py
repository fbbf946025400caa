"""An installation that cannot be written, without a home that can: kernels are kept elsewhere, or not at all."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("sinan", "sensors", "estimator", "calibration", "experiments")
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1  # linux/prctl.h, linux/capability.h

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="permissions are taken away as Linux has it"
)


def as_any_user() -> None:
    """Obey permissions, which root does not: take its right to pass over them away from what is run next."""
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages and a home, none of which can be written."""
    folder = tmp_path_factory.mktemp("installed")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "datasets"))
    shutil.copytree(
        ROOT / "experiments/datasets", folder / "experiments/datasets", ignore=shutil.ignore_patterns("*.csv")
    )
    (folder / "home").mkdir()
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    yield folder
    for path in [folder, *folder.rglob("*")]:
        if path.is_dir():
            path.chmod(0o755)


def run(installed: Path, temporary: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    kept = {key: value for key, value in os.environ.items() if key not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    environment = {**kept, "HOME": str(installed / "home"), "TMPDIR": str(temporary), "PYTHONPATH": str(installed)}
    return subprocess.run(
        [sys.executable, *arguments], cwd=installed, env=environment, preexec_fn=as_any_user, capture_output=True,
        text=True, timeout=300, check=False,
    )  # fmt: skip


ASKED = """
from sinan.estimator.filter.engine_numba import run_chunk
from sinan.estimator.filter.kernel_cache import kernel_cache
from sinan.estimator.filter.compiled import is_compiled
from sinan.experiments.report.console import working
print(run_chunk.stats.cache_path, is_compiled())
for _ in range(2):
    with working("flying", flies=True):
        pass
"""


def test_kernels_are_kept_in_a_folder_of_the_users_own(installed: Path, tmp_path: Path) -> None:
    result = run(installed, tmp_path, "-c", ASKED)
    assert result.returncode == 0, result.stderr
    folder = tmp_path / f"sinan-kernels-{os.getuid()}"
    assert result.stdout.startswith(str(folder))
    assert result.stdout.endswith("False\n")
    assert folder.stat().st_mode & 0o777 == 0o700
    assert result.stderr.splitlines() == [
        f"note: compiled kernels are kept in {folder}: no folder of the installation or of HOME can be written"
    ]


@pytest.mark.parametrize("prepared", ["open to all", "a link"])
def test_a_folder_that_another_may_have_filled_is_not_used(installed: Path, tmp_path: Path, prepared: str) -> None:
    folder = tmp_path / f"sinan-kernels-{os.getuid()}"
    if prepared == "a link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "elsewhere")
    else:
        folder.mkdir()
        folder.chmod(0o777)
    result = run(installed, tmp_path, "-c", ASKED)
    assert result.returncode == 0, result.stderr
    assert result.stdout == "None False\n"
    assert len(result.stderr.splitlines()) == 1
    assert result.stderr.startswith("note: the filter is compiled anew in every run, up to a minute: no folder")
    assert "NUMBA_CACHE_DIR=FOLDER names another" in result.stderr


def test_commands_that_compile_nothing_say_nothing(installed: Path, tmp_path: Path) -> None:
    simulated = run(installed, tmp_path, "-m", "sinan", "simulate", "mag_poses", str(tmp_path / "run"))
    assert (simulated.returncode, simulated.stderr) == (0, "")
    files = "--html", str(tmp_path / "page.html")
    calibrated = run(installed, tmp_path, "-m", "sinan", "calibrate", "mag", str(tmp_path / "run"), *files)
    assert calibrated.returncode == 0
    assert calibrated.stderr == ""
