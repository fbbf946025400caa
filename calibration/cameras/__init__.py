"""Calibration of cameras: lens, mounting, several at once."""
