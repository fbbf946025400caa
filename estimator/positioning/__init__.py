"""Positions from pseudoranges, and their integrity."""
