"""Measured logs through the filter: noise from the log, accuracy against a reference where there is one."""
