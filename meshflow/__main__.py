"""``python -m meshflow`` is the command ``meshflow``."""

from meshflow.cli import main

main()
