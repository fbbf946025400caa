"""The blind benchmark on measured logs: an effect is put into the readings of a minute, and the tracer is asked."""
