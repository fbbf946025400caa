"""A log over time: no peak is lost, gaps stay gaps, spectra are right, pages stay small, events are where they were."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sinan
from sinan.estimator.filter.faults import Note
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.commands.estimate import run as estimate
from sinan.experiments.report.page import Page
from sinan.experiments.review.curves import Curve, Event, Panel, Review, Section, broken, thinned
from sinan.experiments.review.drawing import decades, drawn, ticks, values_span
from sinan.experiments.review.events import gap_events
from sinan.experiments.review.flight import Flown, flight_review
from sinan.experiments.review.of_answers import review_of_estimate
from sinan.experiments.review.readings import readings_review
from sinan.experiments.review.spectrum import amplitude_density
from sinan.experiments.scenarios import simulate_to_folder
from sinan.sensors.formats.dataflash_messages import read_messages
from sinan.sensors.formats.happenings import happenings_of
from sinan.sensors.recording import ACCEL, GYRO, MAG, NO_HEIGHT, Recording, Stream
from tests.estimator.analytic_flight import fly
from tests.sensors.test_tlog import written as telemetry

MEGABYTE = 1e6


@given(st.integers(1, 4000), st.integers(1, 300), st.integers(0, 2**32 - 1))
def test_thinned_curve_keeps_every_peak_and_every_gap(n: int, most: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = np.sort(rng.uniform(0.0, 9.0, n)), rng.normal(size=n)
    y[rng.random(n) < 0.01] = np.nan
    u, v = thinned(x, y, most)
    assert len(u) == len(v) <= max(n, 2 * (most + 2 * int(np.sum(np.isnan(y)))))
    assert np.all(np.diff(u) >= 0.0)
    assert np.any(np.isnan(v)) == np.any(np.isnan(y))
    if not np.all(np.isnan(y)):
        assert (np.nanmin(v), np.nanmax(v)) == (np.nanmin(y), np.nanmax(y))
    assert set(v[np.isfinite(v)]) <= set(y[np.isfinite(y)])


def test_no_line_is_drawn_across_a_gap() -> None:
    t = np.concatenate([np.arange(0.0, 5.0, 0.01), np.arange(8.0, 12.0, 0.01)])
    x, y = broken(t, np.ones(len(t)))
    assert x[np.isnan(y)] == pytest.approx([4.99])


def test_spectrum_of_a_sine_and_of_white_noise() -> None:
    """Amplitude 2 at 40 Hz has a power of 2; white noise of density N has density sqrt(2) N on one side."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 60.0, 0.002)
    found = amplitude_density(t, np.stack([2.0 * np.sin(2.0 * np.pi * 40.0 * t), rng.normal(0.0, 3.0, len(t))], axis=1))
    assert found is not None
    frequency, density = found
    step = frequency[1] - frequency[0]
    assert frequency[np.argmax(density[:, 0])] == pytest.approx(40.0, abs=step)
    assert np.sum(density[:, 0] ** 2) * step == pytest.approx(2.0, rel=0.01)
    assert np.sqrt(np.mean(density[:, 1] ** 2)) == pytest.approx(3.0 * np.sqrt(2.0 * 0.002), rel=0.02)


def test_spectrum_is_of_the_longest_stretch_without_a_gap() -> None:
    t = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(50.0, 80.0, 0.01)])
    found = amplitude_density(t, np.sin(2.0 * np.pi * 5.0 * t)[:, None])
    assert found is not None
    assert found[0][-1] == pytest.approx(50.0, rel=0.01)


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(3, 8))
def test_ticks_are_round_few_and_inside(low: float, width: float, about: int) -> None:
    found = [value for value, _ in ticks(low, low + width, about)]
    assert 1 <= len(found) <= about + 1
    assert all(low - 1e-6 * width <= value <= low + width * (1.0 + 1e-6) for value in found)


def test_decades_are_written_as_numbers() -> None:
    assert [text for _, text in decades(-1.0, 2.0, 6)] == ["0.1", "1", "10", "100"]
    assert [text for _, text in decades(0.0, 1.0, 6)] == ["1", "2", "5", "10"]


def test_first_view_of_innovations_is_not_that_of_the_first_one() -> None:
    t = np.arange(500.0)
    nu, bound = np.sin(t), np.full(500, 2.0)
    nu[0] = bound[0] = 900.0
    panel = Panel("GPS", "m", (Curve("95 %", t, bound, "bound"), Curve("north", t, nu, "dots")), robust=True)
    assert 2.0 < values_span(panel)[1] < 5.0


def test_fixes_in_two_dimensions_have_no_innovation_of_height() -> None:
    """Whose bounds are 20 km, and in which is what stands in the place of the height."""
    recording, _ = fly(2, duration=3.0, sensors=("gps", "mag"))
    gps = recording.streams["gps"]
    flat = Stream(gps.t, {**gps.columns, "down": np.full(len(gps), 500.0), "epv": np.full(len(gps), NO_HEIGHT)})
    log = recording.replace(streams={**recording.streams, "gps": flat})
    journal = run_filter(Flight.of(log), engine="numba")
    review = flight_review(Flown(log, journal.imu_t, journal.imu_x, journal, True))
    panels = [panel for panel in review.panels if panel.robust and panel.title.startswith("GPS")]
    innovations = {panel.title: {curve.name for curve in panel.curves} for panel in panels}
    assert innovations == {"GPS position": {"north", "east"}, "GPS velocity": {"north", "east", "down"}}


def test_an_estimate_is_drawn_and_told_over_the_time_since_the_first_sample() -> None:
    recording, _ = fly(2, duration=5.0, sensors=("gps", "mag"))
    epoch = 1_629_000_000.0
    later = {name: Stream(one.t + epoch, one.columns) for name, one in recording.streams.items()}
    found = sinan.estimate(recording.replace(streams=later, truth=None))
    note = Event("refused", epoch + 1.0, epoch + 2.0, "note")
    review = review_of_estimate(found.recording, found.journal, None)
    assert review.span == pytest.approx((0.0, 5.0), abs=0.1)
    assert all(abs(curve.x[0]) < 1.5 for panel in review.panels if panel.axis == "time" for curve in panel.curves)
    (told,) = replace(review, events=(note,)).counted_from(epoch).events
    assert (told.start, told.stop) == (1.0, 2.0)
    said = [text for text in found.document["notes"] if text.startswith("times are told in seconds after")]
    assert len(said) == 1
    assert str(Note("gps", "frozen", 313.0, 314.5, "left out")).startswith("gps: frozen from 313.000 to 314.500 s")
    assert Note("gps", "gap", 313.0, 313.0, "left out").told(311.0) == "gps: gap at 2.000 s, left out"


def test_page_of_an_hour_at_a_thousand_hertz_stays_small(tmp_path: Path) -> None:
    """60 curves, two of them as long as that."""
    t = np.linspace(0.0, 3600.0, 3_600_000)
    long = Panel("long", "", tuple(Curve(f"{k}", t, np.sin(t * (k + 1)), colour=k) for k in range(2)))
    t = np.linspace(0.0, 3600.0, 100_000)
    rng = np.random.default_rng(0)
    rest = [Panel(f"{k}", "", tuple(Curve("", t, rng.normal(size=len(t))) for _ in range(2))) for k in range(29)]
    page = Page("an hour")
    page.part(drawn(Review((0.0, 3600.0), (Section("all", (long, *rest)),))))
    page.write(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size < 2.2 * MEGABYTE  # with a megabyte of figures below 3


def test_data_of_a_page_are_the_readings() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    y = np.cos(t)
    y[50] = np.nan
    text = drawn(Review((0.0, 9.9), (Section("all", (Panel("one", "m", (Curve("y", t, y),)),)),))).html
    found = re.search(r'class="data">(.*?)</script>', text)
    assert found is not None
    data = json.loads(found[1])
    curve = data["panels"][0]["curves"][0]
    values = np.frombuffer(base64.b64decode(curve["y"]), "<u2")
    stamps = np.frombuffer(base64.b64decode(data["clocks"][curve["x"]]), "<f4")
    assert stamps == pytest.approx(t, abs=1e-6)
    assert np.flatnonzero(values == 65535).tolist() == [50]
    good = values != 65535
    assert curve["low"] + curve["scale"] * values[good] == pytest.approx(y[good], abs=2e-5)


def test_name_out_of_a_log_stays_a_text() -> None:
    hostile = "</script><script>alert(1)</script>"
    panel = Panel(hostile, hostile, (Curve(hostile, np.arange(9.0), np.arange(9.0)),), note=hostile)
    text = drawn(Review((0.0, 8.0), (Section(hostile, (panel,), hostile),))).html
    assert text.count("<script") == text.count("</script>") == 1
    assert "alert(1)<" not in text


def test_gaps_are_events() -> None:
    t = np.delete(np.arange(0.0, 20.0, 0.01), slice(500, 700))
    columns = {name: np.ones(len(t)) for name in (*ACCEL, *GYRO)}
    found = gap_events(Recording("log", "flight", {"imu": Stream(t, columns)}))
    assert [(event.kind, event.start, event.stop) for event in found] == [
        ("gaps, IMU", pytest.approx(4.99), pytest.approx(7.0))
    ]


def test_poses_are_shown_over_their_number() -> None:
    rng = np.random.default_rng(1)
    columns = dict(zip(MAG, rng.normal(size=(3, 12)), strict=True))
    review = readings_review(Recording("poses", "poses", {"poses": Stream(np.arange(12.0), columns)}))
    assert review.axis == "reading"
    assert [panel.title for panel in review.panels] == ["Magnetometer"]


def test_page_of_an_estimate_shows_the_log_over_time(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text('like = "hover"\n[[manoeuvre]]\nkind = "hold"\nduration = 6.0\n')
    simulate_to_folder(str(tmp_path / "short.toml"), tmp_path / "flight", [], False, 0)
    estimate(str(tmp_path / "flight"), "auto", None, None, tmp_path / "flight.json", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    for title in ("Path from above", "Height", "Roll and pitch", "Velocity", "Accelerometer", "Vibration",
                  "Spectrum of the gyroscope", "GPS position"):  # fmt: skip
        assert f"<b>{title}</b>" in text, title
    assert "The reference is the simulation." in text
    (log,) = json.loads((tmp_path / "flight.json").read_text())["logs"]
    assert re.fullmatch("[0-9a-f]{64}", log["sha256"])
    assert log["sha256"] in text


def test_dataflash_tells_when_it_was_armed_and_how_it_flew(tmp_path: Path) -> None:
    log = tmp_path / "log.log"
    log.write_text(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
        "FMT, 1, 12, EV, QB, TimeUS,Id\nFMT, 2, 14, MODE, QMBB, TimeUS,Mode,ModeNum,Rsn\n"
        "FMT, 3, 75, MSG, QZ, TimeUS,Message\nMSG, 900000, ArduCopter V4.5\nMODE, 1000000, 0, 0, 1\n"
        "EV, 2000000, 10\nEV, 2500000, 28\nMODE, 3000000, 5, 5, 1\nEV, 9000000, 11\n"
    )
    assert read_messages(log).counts["EV"] == 3
    found = [(one.kind, one.start, one.stop, one.label) for one in happenings_of(log)]
    assert found == [
        ("armed", 2.0, 9.0, "armed"), ("mode", 1.0, 3.0, "stabilize"), ("mode", 3.0, np.inf, "loiter")
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("autopilot", "modes", "names"),
    [
        (3, (5, 5, 6), ["loiter", "return"]),
        (12, (3 << 16, 4 << 16 | 4 << 24, 4 << 16 | 5 << 24), ["position", "mission", "return"]),
    ],
)
def test_telemetry_tells_when_it_was_armed_and_how_it_flew(
    autopilot: int, modes: tuple[int, ...], names: list[str], tmp_path: Path
) -> None:
    """By the vehicle's own heart beats, not the ground station's."""
    beats = [
        (10.0 + k, "HEARTBEAT", {"autopilot": autopilot, "type": 2, "base_mode": 128 * (k > 0), "custom_mode": mode})
        for k, mode in enumerate(modes)
    ]
    station = [(10.5 + k, "HEARTBEAT", {"autopilot": 8, "type": 6}) for k in range(3)]
    (tmp_path / "a.tlog").write_bytes(telemetry(sorted([*beats, *station], key=lambda one: one[0])))
    found = happenings_of(tmp_path / "a.tlog")
    assert [one.label for one in found] == ["armed", *names]
    assert [one.stop for one in found[1:-1]] == [one.start for one in found[2:]]
    assert [one.kind for one in found] == ["armed", *["mode"] * len(names)]


@pytest.mark.measured
def test_ulog_tells_when_it_was_armed_and_how_it_flew(measured_data: Path) -> None:
    found = happenings_of(measured_data / "px4_esc_lidar_flight" / "esc_status_log.ulg")
    assert [one.label for one in found] == ["armed", "mission", "return"]
