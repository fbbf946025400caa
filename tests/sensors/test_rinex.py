"""RINEX readers: round trips, every kind of damage, and no input that breaks them."""

from __future__ import annotations

import contextlib
import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex import read_navigation, read_observations
from sinan.sensors.formats.rinex_text import fixed_point
from tests.estimator import gnss_simulation as simulation

MILLIMETRE = 1e-3  # m, the resolution of a RINEX pseudorange

NAVIGATION = simulation.messages("GE")
OBSERVED = simulation.observe(NAVIGATION, simulation.START + 30.0 * np.arange(3))
TEXT_3, TEXT_2 = simulation.observation_3(OBSERVED), simulation.observation_2(OBSERVED)
NAV_3, NAV_2 = simulation.navigation_3(NAVIGATION), simulation.navigation_2(simulation.messages("G"))


def write(folder: Path, text: str | bytes, name: str = "file") -> Path:
    path = folder / name
    path.write_bytes(text.encode("latin-1") if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize("text", [TEXT_3, TEXT_2, TEXT_3.replace("\n", "\r\n")], ids=["3", "2.11", "CR LF"])
def test_observations_come_back(tmp_path: Path, text: str) -> None:
    read = read_observations(write(tmp_path, text))
    assert read.journal == ()
    assert read.week == OBSERVED.week
    np.testing.assert_allclose(read.t, OBSERVED.t, atol=1e-7)
    np.testing.assert_array_equal(read.satellite, OBSERVED.satellite)
    name = "C1X" if "C1X" in read.values else "C1C"
    galileo = read.system == "E"
    value = np.where(galileo, read.values[name], read.values["C1C"])
    np.testing.assert_allclose(value, OBSERVED.values["C1C"], atol=0.51 * MILLIMETRE)


@pytest.mark.parametrize("text", [NAV_3, NAV_2], ids=["3", "2.11"])
def test_navigation_comes_back(tmp_path: Path, text: str) -> None:
    read = read_navigation(write(tmp_path, text))
    expected = NAVIGATION.kepler[: len(read.kepler)]
    assert read.journal == ()
    assert read.klobuchar is not None
    np.testing.assert_allclose(read.klobuchar, simulation.KLOBUCHAR, rtol=1e-3)
    for name in ("toc", "toe", "af0", "e", "sqrt_a", "m0", "cus", "omega_dot", "group_delay", "health"):
        np.testing.assert_allclose(read.kepler[name], expected[name], rtol=1e-11, err_msg=name)


def test_gzip_is_read(tmp_path: Path) -> None:
    read = read_observations(write(tmp_path, gzip.compress(TEXT_3.encode())))
    np.testing.assert_array_equal(read.satellite, OBSERVED.satellite)


def test_compact_rinex_is_read(tmp_path: Path) -> None:
    hatanaka = pytest.importorskip("hatanaka")
    packed = hatanaka.rnx2crx(TEXT_3.encode())
    read = read_observations(write(tmp_path, packed))
    np.testing.assert_array_equal(read.satellite, OBSERVED.satellite)


def test_rinex_4_titles_and_ionosphere(tmp_path: Path) -> None:
    head, body = NAV_3.split("END OF HEADER\n")
    kept = [line for line in head.splitlines() if "IONO" not in line]
    head = "\n".join(kept).replace("3.04", "4.00") + "END OF HEADER\n"
    first = "".join(body.splitlines(keepends=True)[:8])
    numbers = [f"{x:19.12e}" for x in simulation.KLOBUCHAR]
    klobuchar = f"    2022 03 10 00 00 00{''.join(numbers[:3])}\n    {''.join(numbers[3:7])}\n    {numbers[7]}\n"
    newer = "> EPH G01 CNV2\n" + first
    read = read_navigation(write(tmp_path, head + newer + "> EPH G01 LNAV\n" + first + "> ION G01 LNAV\n" + klobuchar))
    assert read.kepler["satellite"].tolist() == ["G01"]
    assert any("CNV2" in line for line in read.journal)
    np.testing.assert_allclose(read.klobuchar, simulation.KLOBUCHAR, rtol=1e-11)


DAMAGE_3 = {
    "truncated": (TEXT_3[:-40], "truncated", 2),
    "duplicate": (TEXT_3 + TEXT_3[TEXT_3.rindex(">") :], "duplicate", 3),
    "goes back": (TEXT_3 + TEXT_3[TEXT_3.index(">") : TEXT_3.index(">", TEXT_3.index(">") + 1)], "goes back", 3),
    "century": (TEXT_3.replace("> 2022", "> 1922", 1), "no time", 2),
    "no date": (TEXT_3.replace("> 2022 03 10", "> 2022 13 40", 1), "no time", 2),
    "letters": (TEXT_3.replace(" 45.000", " 4x.000", 1), "not a number", 3),
}


@pytest.mark.parametrize(("text", "word", "epochs"), DAMAGE_3.values(), ids=DAMAGE_3.keys())
def test_damage_costs_its_epoch_and_a_line(tmp_path: Path, text: str, word: str, epochs: int) -> None:
    read = read_observations(write(tmp_path, text))
    assert len(read.t) == epochs
    assert len(read.journal) == 1
    assert word in read.journal[0]


def test_zero_pseudorange_is_left_out(tmp_path: Path) -> None:
    start = TEXT_3.index("G", TEXT_3.index(">"))
    text = TEXT_3[: start + 3] + f"{0.0:14.3f}" + TEXT_3[start + 17 :]
    read = read_observations(write(tmp_path, text))
    assert np.isnan(read.values["C1C"]).sum() == 1
    assert "zero pseudorange" in read.journal[0]


def test_truncated_rinex_2(tmp_path: Path) -> None:
    read = read_observations(write(tmp_path, TEXT_2[:-50]))
    assert len(read.t) == 2
    assert "truncated" in read.journal[0]


def test_rinex_2_finds_the_next_epoch_after_damage(tmp_path: Path) -> None:
    lines = TEXT_2.splitlines(keepends=True)
    epochs = [k for k, line in enumerate(lines) if line.startswith(" 22")]
    del lines[epochs[0] + 3]
    read = read_observations(write(tmp_path, "".join(lines)))
    assert len(read.t) == 2
    assert "another one starts inside" in read.journal[0]


def test_truncated_navigation(tmp_path: Path) -> None:
    read = read_navigation(write(tmp_path, NAV_3[:-100]))
    assert len(read.kepler) == len(NAVIGATION.kepler) - 1
    assert "truncated" in read.journal[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "RINEX VERSION"),
        ("hello\n", "RINEX VERSION"),
        (TEXT_3[:300], "END OF HEADER"),
        (NAV_3, "type `O`"),
        (TEXT_3.replace("3.04", "9.04", 1), "RINEX 2.10 to 4"),
        (TEXT_3[: TEXT_3.index(">")], "at least one complete epoch"),
        (gzip.compress(TEXT_3.encode())[:50], "gzip"),
    ],
    ids=["empty", "text", "header cut", "navigation", "version", "no epoch", "gzip cut"],
)
def test_what_is_no_observation_file_says_so(tmp_path: Path, text: str | bytes, expected: str) -> None:
    with pytest.raises(InputError, match=expected) as error:
        read_observations(write(tmp_path, text))
    assert "\n" not in str(error.value)


def test_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_observations(tmp_path / "none")


@given(st.floats(-9999999999.0, 9999999999.0, allow_nan=False))
def test_fixed_point_reads_as_python_does(value: float) -> None:
    text = f"{value:14.3f}"
    if len(text) == 14:
        number, damaged = fixed_point(np.frombuffer(text.encode(), dtype=np.uint8).reshape(1, 14))
        assert not damaged[0]
        assert number[0] == float(text)


def reads_or_says_why(folder: Path, data: bytes) -> None:
    path = write(folder, data)
    for reader in (read_observations, read_navigation):
        with contextlib.suppress(InputError):
            reader(path)


HEADERS = [text[: text.index("END OF HEADER\n") + 14] for text in (TEXT_3, TEXT_2, NAV_3, NAV_2)]


@settings(max_examples=150, deadline=2000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(header=st.sampled_from(["", *HEADERS]), body=st.binary(max_size=600))
def test_any_bytes_are_read_or_refused(tmp_path: Path, header: str, body: bytes) -> None:
    reads_or_says_why(tmp_path, header.encode() + body)


@settings(max_examples=150, deadline=2000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    text=st.sampled_from([TEXT_3, TEXT_2, NAV_3, NAV_2]),
    changes=st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), max_size=12),
    cut=st.floats(0.0, 1.0),
)
def test_any_change_is_read_or_refused(tmp_path: Path, text: str, changes: list[tuple[float, int]], cut: float) -> None:
    data = bytearray(text.encode())
    for place, byte in changes:
        data[int(place * (len(data) - 1))] = byte
    reads_or_says_why(tmp_path, bytes(data[: int(len(data) * max(cut, 0.1))]))


@pytest.mark.measured
def test_measured_file_reads_as_slicing_does(measured_data: Path) -> None:
    path = measured_data / "gnss/esbjerg_static_2020/ESBC00DNK_R_20201771200_01H_30S_MO.rnx"
    read = read_observations(path, "CLDS")
    lines = [line for line in path.read_text().split("END OF HEADER")[1].splitlines() if line.startswith("G")]
    rows = np.flatnonzero(read.system == "G")
    assert len(lines) == len(rows)
    for column, name in ((3, "C1C"), (51, "C2W"), (147, "L1C"), (211, "S1C")):
        expected = [float(line[column : column + 14].strip() or "nan") for line in lines]
        np.testing.assert_array_equal(read.values[name][rows], expected)
