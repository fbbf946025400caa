"""Flights as a source: passes of the filter, candidates, fits, and readings that were withheld."""
