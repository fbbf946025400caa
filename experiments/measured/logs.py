"""The measured logs that the gallery, the tables and the benchmarks go through, by the names that they have there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sinan.experiments.datasets import load_dataset


@dataclass(frozen=True)
class Entry:
    """One log.

    Attributes
    ----------
    input : what a command takes
    sensor : that is traced of poses with several
    about : what is said of it beforehand
    """

    input: str
    sensor: str | None = None
    about: str = ""


_BROAD = "broad_orientation"
_PHANTOM = "phantom4_xsens_dot/Xsens DOT1_D422CD003EBC_20220707_111438.csv"
_INDOORS = "px4_vio_quad/7c824ee5-cf25-4c19-8739-12455adfae23"
_THOR = "thor_fixed_wing/thor_flight75_WaypointTracker_150squareWaypointNew_2012_10_10.mat"


def _broad() -> dict[str, Entry]:
    """The hand-held trials: their names begin with a number, end with a session's letter, and say what is done."""
    entries = {}
    for log in load_dataset(_BROAD).logs():
        number, disturbed, *words = log.removesuffix(".mat").split("_")
        done = " ".join(word for word in words if len(word) > 1)
        entries[f"BROAD {number}, {done}"] = Entry(f"{_BROAD}/{log}", about=f"In the hand, {disturbed}: {done}.")
    return entries


#: Logs of poses, and of a compass that turns enough.
POSES: Mapping[str, Entry] = {
    "course, accelerometer": Entry("rfly_course/AccRaw.mat", about="Ten poses, each the mean of 100 readings."),
    "course, magnetometer": Entry("rfly_course/MagRaw.mat", about="Six faces, turned about the vertical on each."),
    "Xsens MTi, accelerometer": Entry("xsens_mti_imu_tk/xsens_acc.mat.gz", "accel", "Static poses, turned by hand."),
    "Xsens MTi, gyroscope": Entry("xsens_mti_imu_tk/xsens_acc.mat.gz", "gyro", "The turns between those poses."),
    **{
        f"MPU-9150 {k}, {words}": Entry(f"mpu9150_imu_calib/imu{k}.log", sensor, "22 static poses, turned by hand.")
        for k in range(3)
        for sensor, words in (("accel", "accelerometer"), ("gyro", "gyroscope"))
    },
    "HMC5883L, sphere": Entry(
        "mpu6050_hmc5883l/set-2/full-sphere/hmc5883l_compass.mat", about="Turned by hand through all directions."
    ),
    "QMC5883L, noisy": Entry("qmc5883l_mag_calib/noisy_raw_data.csv", about="Turned by hand."),
    "QMC5883L, filtered": Entry(
        "qmc5883l_mag_calib/filtered_raw_data.csv", about="Another recording, filtered in a way that is not stated."
    ),
    "PX4 indoors, second compass": Entry(
        f"{_INDOORS}_sensor_mag_1.csv", about="A quadrotor's compass on the ground and in the air, up to 18 A."
    ),
}
#: Logs without an IMU, whose compass can be looked at along a known attitude alone.
COMPASSES: Mapping[str, Entry] = {
    "PX4 with 64 A": Entry("px4_quad_64a", about="A quadrotor in the air; its IMU was not kept."),
}
#: Logs with an IMU that moves.
FLIGHTS: Mapping[str, Entry] = {
    "course, quadrotor": Entry("rfly_course/attitude_logdata.mat", about="A flight without magnetometer or GPS."),
    "course, turned by hand": Entry("rfly_course/e4_A.bin", about="The same autopilot in the hand."),
    **_broad(),
    "x-io, hand and turntable": Entry(
        "xio_fusion_imu/sensor_data.csv", about="Turned by hand, on a turntable, a magnet."
    ),
    "robot, MPU-9150": Entry("robot_arm_marg/eV50p/Sequencia1/MPU9150.mat", about="Turned by a robot arm."),
    "robot, LSM9DS0": Entry("robot_arm_marg/eV50p/Sequencia1/LSM9DS0.mat", about="The same path, another instrument."),
    "robot fast, LSM9DS0": Entry("robot_arm_marg/V_800/Sequencia3/LSM9DS0.mat", about="A faster path."),
    "variometer": Entry("vario_imu_baro/ms5611_datalog", about="Moved up and down by hand for 19 s."),
    "walk, RTK": Entry("boulder_walk_imu_2025/gnss_1730.ubx", about="A walk with RTK and a consumer IMU."),
    "strapped to a Phantom": Entry(_PHANTOM, about="An instrument strapped to a quadrotor, alone."),
    "strapped to a Phantom, RTK": Entry(f"{_PHANTOM}#rtk", about="The same, aided by the aircraft's RTK."),
    "PX4, IMU at 10 Hz": Entry("px4_esc_lidar_flight/esc_status_log.ulg", about="An IMU logged far below its rate."),
    "PX4, IMU at 200 Hz": Entry(
        "px4_v6xrt_flight/corrupt_unregistered_msg_id.ulg",
        about="A quadrotor; its compass is logged at 2 Hz, GPS at 0.6.",
    ),
    "PX4 indoors": Entry("px4_vio_quad", about="A quadrotor without GPS, its IMU logged at 10 Hz."),
    "PX4 indoors, odometry": Entry(
        f"{_INDOORS}_vehicle_visual_odometry_0.csv", about="The same, aided by the place that its camera gives."
    ),
    "aeroplane": Entry(_THOR, about="A small aeroplane in squares of 150 m, with GPS, pitot tube and its motor's log."),
    "F450": Entry("inertialnav_quads/f450_glitch_log.zip", about="A quadrotor with a disturbed GPS."),
    "quad, slow": Entry("inertialnav_quads/quad123.zip", about="A quadrotor, slow flight at two heights."),
    "quad, 14 m/s": Entry("inertialnav_quads/quad106.zip", about="A quadrotor with sonar, up to 14 m/s."),
    "quad, laser": Entry("inertialnav_quads/quadOptFlowLogData.zip", about="A quadrotor with a laser, circles."),
}
LOGS: Mapping[str, Entry] = {**POSES, **FLIGHTS}
