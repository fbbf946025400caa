"""Many logs of many vehicles: each traced by itself, then compared."""
