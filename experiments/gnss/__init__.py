"""Positioning studies: a receiver's log, a base, a reference."""
