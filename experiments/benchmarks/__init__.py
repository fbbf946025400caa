"""Measurements of the project itself, each a command: speed, accuracy against other programs, what a bound decides."""
