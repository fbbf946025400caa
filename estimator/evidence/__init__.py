"""What a journal says: scores, sensitivities, consistency, observability; what a source of residuals has to offer."""
