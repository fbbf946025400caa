"""A part of a recording: the same stretch of all streams and of the truth, counted from the first sample."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.joining import joined
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, Initial, Recording, SensorSpec, Stream, Truth
from sinan.sensors.window import WHOLE, between, second_words, span_words, told_from, told_from_note, window

#: What the clock of the log shows at its first IMU sample [s].
START = 1000.0


def log(kind: str = "flight") -> Recording:
    """A minute at 10 Hz, GPS at 1 Hz half a second before the first IMU sample, power once; the truth at 2 Hz."""
    t = START + np.arange(0.0, 60.0, 0.1)
    imu = Stream(t, {name: t + k for k, name in enumerate((*ACCEL, *GYRO))})
    gps = START - 0.5 + np.arange(0.0, 60.0)
    truth = START + np.arange(0.0, 60.0, 0.5)
    return Recording(
        "log", "flight" if kind == "flight" else "poses",
        {"imu": imu, "gps": Stream(gps, {name: gps + k for k, name in enumerate(POSITION)}),
         "power": Stream(np.array([START + 3.0, START + 30.0]), {"current": np.ones(2)})},
        {"accel": SensorSpec(bias_std=0.1, bias_walk=0.02), "gps": SensorSpec(noise_std=1.0, bias_std=0.0)},
        initial=Initial(position=np.ones(3), position_std=1.0),
        truth=Truth(Stream(truth, dict.fromkeys(POSITION, truth)), "rtk"),
    )  # fmt: skip


def test_all_streams_and_the_truth_are_cut_alike() -> None:
    part = window(log(), (10.0, 20.0))
    assert part.truth is not None
    for stream in (*part.streams.values(), part.truth.stream):
        assert np.all((stream.t >= START + 10.0) & (stream.t < START + 20.0))
    assert {name: len(stream) for name, stream in part.streams.items()} == {"imu": 100, "gps": 10}
    assert (len(part.truth.stream), part.truth.kind) == (20, "rtk")
    np.testing.assert_array_equal(part.streams["imu"]["accel_y"], part.streams["imu"].t + 1)
    assert part.notes == (
        "from 10 s to 20 s of the log, counted from its first sample",
        "power: fewer than 2 readings in that part, left out",
    )


def test_parts_side_by_side_share_no_row() -> None:
    whole, parts = log(), [window(log(), (a, a + 20.0)) for a in (0.0, 20.0, 40.0)]
    again = np.concatenate([part.streams["imu"].t for part in parts])
    np.testing.assert_array_equal(again, whole.streams["imu"].t)


def test_a_first_state_is_that_of_the_beginning() -> None:
    """A part from later on has to find its own, and its bias may have wandered: variance + walk^2 t."""
    first, later = window(log(), (None, 20.0)), window(log(), (25.0, None))
    assert first.initial.position is not None
    assert first.sensors == log().sensors
    assert first.streams["gps"].t[0] == START - 0.5
    assert later.initial == Initial()
    assert later.spec("accel").bias_std == pytest.approx(np.sqrt(0.1**2 + 0.02**2 * 25.0))
    assert later.spec("gps") == log().spec("gps")


def test_a_bias_of_logs_that_are_joined_wanders_from_the_first_sample_of_its_own() -> None:
    both = joined([log(), log()])
    (second,) = both.breaks
    for begin, since in ((second, 0.0), (second + 16.0, 16.0), (START + 25.0, 25.0)):
        part = between(both, begin, np.inf)
        assert part.spec("accel").bias_std == pytest.approx(np.sqrt(0.1**2 + 0.02**2 * since))


def test_the_whole_is_the_recording_itself() -> None:
    recording = log()
    assert window(recording, WHOLE) is recording
    assert span_words(WHOLE) == ""


def test_poses_without_time_are_cut_by_their_number() -> None:
    rows = np.arange(30.0)
    poses = Recording("poses", "poses", {"poses": Stream(rows, dict.fromkeys(MAG, rows))})
    np.testing.assert_array_equal(window(poses, (10.0, 20.0)).streams["poses"].t, np.arange(10.0, 20.0))


def test_a_truth_of_another_time_is_none() -> None:
    early = log().replace(truth=Truth(Stream(np.array([START]), dict.fromkeys(POSITION, np.ones(1)))))
    assert window(early, (30.0, None)).truth is None


@pytest.mark.parametrize(
    ("span", "says"),
    [
        ((50.0, 20.0), "--from and --to: 50 s and 20 s; expected a --from before the --to"),
        ((60.0, None), "from 60 s of a log of 59.9 s; expected a part from 0 to 59.9 s"),
        ((None, -1.0), "0 s and -1 s"),
        ((-9.0, -1.0), "from -9 s to -1 s of a log of 59.9 s"),
        ((np.nan, None), "--from: nan"),
        ((None, np.inf), "--to: inf"),
        ((20.01, 20.12), "fewer than 2 samples from 20.01 s to 20.12 s"),
    ],
)
def test_a_part_that_is_none_is_named(span: tuple[float | None, float | None], says: str) -> None:
    with pytest.raises(InputError) as caught:
        window(log(), span)
    assert says in str(caught.value)


def test_a_part_without_any_stream_is_named() -> None:
    with pytest.raises(InputError, match="fewer than 2 samples"):
        between(log().replace(streams={"power": log().streams["power"]}), START + 4.0, START + 5.0)


def moved(recording: Recording, by: float) -> Recording:
    """The same on another clock [s]."""
    streams = {name: Stream(one.t + by, one.columns) for name, one in recording.streams.items()}
    return recording.replace(streams=streams, truth=None)


def test_words_count_from_the_first_sample_of_the_log_as_the_options_do() -> None:
    part = window(window(log(), (10.0, None)), (5.0, 20.0))
    for one in (log(), window(log(), (None, 20.0)), window(log(), (20.0, 40.0)), part):
        assert told_from(one) == START
        assert told_from_note(one) == [
            "times are told in seconds after the log's first sample, 1000.000 s on its own clock: `--from` and `--to` "
            "take them so"
        ]
    again = window(log(), (12.0, 13.0)).streams["imu"].t[0]
    assert second_words(float(again), told_from(log())) == "12"


def test_words_have_the_clock_of_a_log_that_begins_near_zero() -> None:
    near = moved(log(), 0.05 - START)
    for one in (near, window(near, (20.0, 40.0))):
        assert (told_from(one), told_from_note(one)) == (0.0, [])


def test_seconds_have_four_digits_or_are_whole() -> None:
    epoch = 1_629_000_000.0
    said = [second_words(epoch + t, epoch) for t in (-0.0001, 0.0121, 3.1416, 339.72, 12_345.6)]
    assert said == ["0", "0.012", "3.142", "339.7", "12346"]
