"""`python -m sinan` is `sinan`: signals are heard before anything is loaded that takes its time."""

from sinan.experiments.workers.stopping import listening


def main() -> None:
    """Load the command line and run it: Ctrl-C meanwhile ends with status 130 and one line, as later."""
    with listening():
        from sinan.experiments.commands.cli import main as command_line

        command_line()


if __name__ == "__main__":
    main()
