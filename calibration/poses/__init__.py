"""Calibration at rest and by turns: poses of a three-axis sensor, a gyroscope between them."""
