"""One flight many times."""
