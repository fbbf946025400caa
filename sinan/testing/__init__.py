"""Assertions for regression tests of models."""
