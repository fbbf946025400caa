"""The blind benchmark: recordings whose missing effect is sealed, and the score of what the tracer names."""
