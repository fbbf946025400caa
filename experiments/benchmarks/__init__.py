"""Measurements of the project itself, each a command: speed, accuracy beside other programs, what a bound decides."""
