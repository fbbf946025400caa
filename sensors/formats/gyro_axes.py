"""Whether a gyroscope has the axes of the accelerometer: with which of the ways to name and sign them gravity lasts.

A log that does not turn says nothing.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.lasting import other_axes
from sinan.sensors.recording import ACCEL, GYRO, Recording, Stream


def with_axes_of_force(recording: Recording, axes: FloatArray | None = None) -> tuple[Recording, list[str]]:
    """For what holds other readings against the rates: the recording with them about the accelerometer's axes; and a
    sentence where they are not so as read. The recording itself is not to be used further: which of the two is wrong is
    not known.

    Parameters
    ----------
    axes : (3, 3) what the map says of the gyroscope now
    """
    imu = recording.streams.get("imu")
    if imu is None or not imu.has(ACCEL) or not imu.has(GYRO):
        return recording, []
    with np.errstate(all="ignore"):  # a damaged reading gives no number, which says nothing
        found = other_axes(imu)
    if found is None:
        return recording, []
    about = dict(zip(GYRO, (imu.array(GYRO) @ found.axes.T).T, strict=True))
    streams = {**recording.streams, "imu": Stream(imu.t, {**imu.columns, **about})}
    left = f"{100.0 * found.lasting:.0f} % of gravity lasts as they turn it, as read {100.0 * found.as_read:.0f} %"
    note = f"gyro: the gyroscope does not have the axes of the accelerometer; if those are right, {found.words(axes)}"
    return recording.replace(streams=streams), [f"{note}: {left}"]
