"""The filter: a model of the flight, what it runs on, two engines, the journal, the smoother."""
