"""The bias-observability laboratory: which biases a flight shows, by which manoeuvre and which sensor."""
