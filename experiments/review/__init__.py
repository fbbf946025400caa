"""A log as its pilot looks at it: path, height, attitude, speeds, readings, vibration, innovations, events."""
