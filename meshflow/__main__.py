"""``python -m meshflow`` is the command ``meshflow``."""

import gc


def main() -> None:
    """Import the command, and run it."""
    # What is imported stays to the end: to look for cycles in it takes a seventh of the time of a short command.
    gc.disable()
    from meshflow.cli.commands import main as command

    gc.freeze()
    gc.enable()
    command()


if __name__ == "__main__":
    main()
