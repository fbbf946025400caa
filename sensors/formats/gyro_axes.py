"""Whether a gyroscope has the axes of the accelerometer: with which of the ways to name and sign them gravity lasts.

A log that does not turn says nothing.
"""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.lasting import axes_that_last, lasting_gravity
from sinan.sensors.formats.signed_axes import words_of
from sinan.sensors.recording import ACCEL, GYRO, Recording, Stream


def turned(recording: Recording, axes: FloatArray | None = None) -> tuple[Recording, list[str]]:
    """The recording with the rates about the axes of the accelerometer, and a sentence where they are not as read.

    Parameters
    ----------
    axes : (3, 3) what the map says of the gyroscope now
    """
    imu = recording.streams.get("imu")
    if imu is None or not imu.has(ACCEL) or not imu.has(GYRO):
        return recording, []
    with np.errstate(all="ignore"):  # a damaged reading gives no number, which says nothing
        found, as_read = axes_that_last(imu), lasting_gravity(imu, np.eye(3))
    if found is None:
        return recording, []
    S, lasting, others = found
    said = words_of(S @ (np.eye(3) if axes is None else axes))
    said += f", or {others} others that such turns do not tell from it," if others else ""
    would = f"if those are right, axes = {said} in a map would do"
    left = f"{100.0 * lasting:.0f} % of gravity lasts as they turn it, as read {100.0 * as_read:.0f} %"
    about = dict(zip(GYRO, (imu.array(GYRO) @ S.T).T, strict=True))
    streams = {**recording.streams, "imu": Stream(imu.t, {**imu.columns, **about})}
    note = f"gyro: the gyroscope does not have the axes of the accelerometer; {would}: {left}"
    return recording.replace(streams=streams), [note]
