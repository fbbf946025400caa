"""`python -m experiments` is `sinan`."""

from experiments.cli import main

main()
