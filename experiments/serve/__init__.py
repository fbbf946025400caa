"""`sinan serve`: logs dropped into a page on this machine, traced one after the other, read in the browser."""
