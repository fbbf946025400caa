"""One file and two lines: the example of docs/how_to_add_a_format.md, run as it stands there."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import sinan.sensors.formats as formats
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.errors import InputError
from sinan.sensors.formats import columns
from sinan.sensors.recording import ACCEL, GYRO, MAG

GUIDE = Path(__file__).parents[2] / "docs" / "how_to_add_a_format.md"


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The guide's file in a folder of the package, and the guide's lines in their registries."""
    text = GUIDE.read_text(encoding="utf-8")
    code, reader, magic = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    file = re.search(r"`sensors/formats/(imulog\.py)`", text)
    assert file is not None
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / file[1]).write_text(code, encoding="utf-8")
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path / "package")])
    for registry, line in ((formats._READERS, reader), (columns.MAGICS, magic)):
        for key, value in eval("{" + line + "}").items():
            monkeypatch.setitem(registry, key, value)  # type: ignore[arg-type]
    yield
    sys.modules.pop("sinan.sensors.formats.imulog", None)


def _log(path: Path, cut: int = 0) -> Path:
    rows = [(10_000 * k, 0.0, 0.0, -1.0, 0.0, 0.0, 9.0, 20.0, 0.0, 40.0) for k in range(200)]
    data = b"IMULOG01" + b"".join(struct.pack("<I9f", *row) for row in rows)
    path.write_bytes(data[: len(data) - cut])
    return path


@pytest.mark.usefixtures("added")
def test_the_format_of_the_guide_is_read_by_its_content(tmp_path: Path) -> None:
    recording = formats.open_log(_log(tmp_path / "flight.csv"))
    imu, mag = recording.streams["imu"], recording.streams["mag"]
    np.testing.assert_allclose(imu.array(ACCEL)[0], (0.0, 0.0, -STANDARD_GRAVITY), rtol=1e-6)
    np.testing.assert_allclose(imu.array(GYRO)[0], (0.0, 0.0, np.pi / 20), rtol=1e-6)
    np.testing.assert_allclose(mag.array(MAG)[0], (0.2, 0.0, 0.4), rtol=1e-6)
    np.testing.assert_allclose(imu.t[-1], 1.99)


@pytest.mark.usefixtures("added")
def test_its_facts_are_told(tmp_path: Path) -> None:
    facts = formats.facts_of(_log(tmp_path / "flight.bin"))
    assert facts is not None
    assert (facts.tables[0].rows, facts.tables[0].rate) == (200, pytest.approx(100.0))


@pytest.mark.usefixtures("added")
def test_a_log_that_is_cut_off_is_refused_with_the_place(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="byte 7968: 199 records of 40 bytes and 33 bytes more"):
        formats.open_log(_log(tmp_path / "flight.bin", cut=7))


def test_it_is_gone_afterwards() -> None:
    assert "imulog" not in formats._READERS
