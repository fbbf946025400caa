"""Makes corners `experiments/camera/opencv_left.csv` of OpenCV's sample pictures, and its result `camera_left.json`.

    python tests/golden/camera_left.py FOLDER        FOLDER: samples/data of OpenCV, with left01.jpg ... left14.jpg

Pictures and `left_intrinsics.yml` are OpenCV's (Apache 2.0), samples/data, 13 pictures of a board of 9 x 6 inner
corners, squares of 25 mm. "published" is what `left_intrinsics.yml` says: f_x = f_y, five coefficients.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np

from sinan.calibration.cameras.views import Board, views_of, write_corners

ROOT = Path(__file__).resolve().parents[2]


def main(folder: Path) -> None:
    views = views_of(folder, Board(9, 6, 0.025))
    chosen = [view for view in views.views if view.name.startswith("left") and view.name[4].isdigit()]
    write_corners(ROOT / "experiments" / "camera" / "opencv_left.csv", chosen, views.size)
    points = [view.points.astype(np.float32) for view in chosen]
    pixels = [np.round(view.pixels, 4).astype(np.float32) for view in chosen]
    rms, K, k, _, _, std, _, of_view = cv2.calibrateCameraExtended(points, pixels, views.size, None, None)
    published = cv2.FileStorage(str(folder / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    matrix, own = published.getNode("camera_matrix").mat(), published.getNode("distortion_coefficients").mat()
    table = {
        "made_by": f"tests/golden/camera_left.py with OpenCV {cv2.__version__}",
        "opencv": {
            "rms": rms,
            "values": [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *k.ravel().tolist()],
            "std": std.ravel()[:9].tolist(),
            "rms_of_view": of_view.ravel().tolist(),
        },
        "published": {
            "values": [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *own.ravel().tolist()],
            "rms_of_view": published.getNode("per_view_reprojection_errors").mat().ravel().tolist(),
        },
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
