"""sinan: sensor models, calibration, an extended Kalman filter, and a loop that names what a model lacks."""

from pathlib import Path

# Installed, the four parts lie in this folder; in a checkout beside it, so that the tree shows them at its top.
if not (Path(__file__).parent / "sensors").is_dir():
    __path__.append(str(Path(__file__).resolve().parents[1]))
