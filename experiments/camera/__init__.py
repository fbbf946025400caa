"""Calibration of a camera, and the loop on its residual field; `opencv_left.csv`: corners of OpenCV's sample pictures."""
