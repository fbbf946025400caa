"""What a log does not declare: noise, colour, field, heading."""
