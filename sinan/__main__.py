"""`python -m sinan`: the command line."""

from sinan.experiments.__main__ import main

if __name__ == "__main__":
    main()
