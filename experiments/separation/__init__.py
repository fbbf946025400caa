"""Which effects look alike in which manoeuvre."""
