"""Readers of log formats: each turns one format into a `Recording`."""
