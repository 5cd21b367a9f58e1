"""``python -m meshflow`` is the command ``meshflow``."""

from meshflow.cli.commands import main

main()
