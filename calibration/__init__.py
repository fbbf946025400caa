"""What the recording says about the instruments: norms, turns, Allan deviation."""
