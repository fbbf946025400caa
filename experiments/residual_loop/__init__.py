"""The loop: weigh the evidence in a residual, trace it to an effect, add the effect, prove it on held-out data."""
