"""Which biases can be told from a flight, which manoeuvre and which sensor shows them: the bias-observability laboratory."""
