"""Calibration of a camera and the loop on its residual field; `opencv_left.csv` has corners of OpenCV's pictures."""
