"""Tables, figures, pages: formats what the experiments computed, and computes nothing itself."""
