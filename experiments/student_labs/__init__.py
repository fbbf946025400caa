"""Labs for students: data of one's own, a notebook with gaps, and a check that hints without telling."""

from __future__ import annotations

#: name -> English and Chinese title; the module of the same name has `LAB`, `texts/NAME.notebook` the notebook
TITLES = {
    "accelerometer": ("accelerometer: ten poses, gravity, one attitude more", "三轴加速度计自动标定"),
    "magnetometer": ("magnetometer: six faces, heading, the motors' current", "三轴磁力计自动标定"),
    "gyroscope": ("gyroscope: bias, scale, how long to rest", "三轴陀螺仪：偏移与尺度因子"),
    "heights": ("heights: sonar, barometer, and both together", "超声波测距仪与气压计测高"),
    "gps": ("GPS: four satellites, one that is off, DGPS", "全球定位系统与差分GPS"),
    "camera": (
        "camera: the pinhole, its distortion, how far apart two have to be",
        "摄像机：针孔成像模型与内部参数校正",
    ),
    "observability": (
        "observability: tilt error and bias, and the turn that parts them",
        "可观性：倾斜误差与加速度计漂移",
    ),
    "loop": ("close the loop: from a residual to an effect, proved on other data", "闭环：从残差到误差模型"),
}
