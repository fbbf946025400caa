"""What the recording says about the motion: filter, journal, sensitivity, score."""
