"""Poses and turns as sources: their rows, probes and faults, and the least squares over them."""
