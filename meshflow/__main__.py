"""``python -m meshflow`` is the command ``meshflow``."""

import atexit
import gc
import sys

# The exit code of a command that Ctrl-C ended.
INTERRUPTED = 130


def main() -> None:
    """Run the command; at its end nobody looks for cycles in all that was imported, which takes a tenth of a second.

    :raises SystemExit: when the command is interrupted before it is imported.
    """
    atexit.register(gc.freeze)
    try:
        from meshflow.cli.commands import main as command
    except KeyboardInterrupt:
        sys.stderr.write("meshflow: interrupted; nothing was done\n")
        raise SystemExit(INTERRUPTED) from None
    command()


if __name__ == "__main__":
    main()
