"""Positions from pseudoranges, their integrity, and what their residuals say of effects and faults."""
