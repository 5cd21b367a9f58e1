"""``python -m meshflow`` is the command ``meshflow``."""

import atexit
import gc

from meshflow.cli.commands import main as command


def main() -> None:
    """Run the command; at its end nobody looks for cycles in all that was imported, which takes a tenth of a second."""
    atexit.register(gc.freeze)
    command()


if __name__ == "__main__":
    main()
