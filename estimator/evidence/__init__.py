"""What a journal says: scores, sensitivities, consistency, observability."""
