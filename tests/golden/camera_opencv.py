"""Makes `camera_opencv.json`: what OpenCV's own cameras show of points, for tests that run without OpenCV.

python tests/golden/camera_opencv.py        with opencv-contrib-python-headless, which has `omnidir`
"""

import json
from pathlib import Path

import cv2
import numpy as np

F, CENTRE = (612.5, 608.25), (322.75, 241.5)
BROWN, FISHEYE = (-0.27, 0.11, 0.0017, -0.0023, -0.031), (0.031, -0.012, 0.0063, -0.0021)
XI, MEI = 0.87, (-0.11, 0.037, 0.0013, -0.0008)


def main() -> None:
    rng = np.random.default_rng(11)
    K = np.array([[F[0], 0.0, CENTRE[0]], [0.0, F[1], CENTRE[1]], [0.0, 0.0, 1.0]])
    ahead = np.column_stack([rng.uniform(-1.2, 1.2, (12, 2)), rng.uniform(1.5, 4.0, 12)])
    ahead[0, :2] = 0.0
    wide = np.column_stack([rng.uniform(-3.0, 3.0, (12, 2)), rng.uniform(0.3, 2.0, 12)])
    rvec, tvec = np.array([0.2, -0.3, 0.1]), np.array([0.1, -0.2, 0.3])
    none = np.zeros(3)
    brown, jacobian = cv2.projectPoints(ahead[:, None], rvec, tvec, K, np.array(BROWN))
    fisheye, _ = cv2.fisheye.projectPoints(wide[:, None], none, none, K, np.array(FISHEYE))
    mei, _ = cv2.omnidir.projectPoints(wide[:, None], none, none, K, XI, np.array(MEI))
    table = {
        "made_by": f"tests/golden/camera_opencv.py with OpenCV {cv2.__version__}",
        "f": F,
        "centre": CENTRE,
        "brown": {
            "k": BROWN,
            "rotation": cv2.Rodrigues(rvec)[0].tolist(),
            "translation": tvec.tolist(),
            "points": ahead.tolist(),
            "pixels": brown[:, 0].tolist(),
            "by_translation": jacobian[:, 3:6].reshape(-1, 2, 3).tolist(),
            "by_values": jacobian[:, 6:15].reshape(-1, 2, 9).tolist(),
        },
        "fisheye": {"k": FISHEYE, "points": wide.tolist(), "pixels": fisheye[:, 0].tolist()},
        "omnidirectional": {"k": (XI, *MEI), "points": wide.tolist(), "pixels": mei[:, 0].tolist()},
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
