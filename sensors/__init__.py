"""What the world shows an instrument: motion, measurement models, effects, recordings."""
