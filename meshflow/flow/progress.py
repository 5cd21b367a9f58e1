"""Progress without printing: a callback, or a bar on stderr where somebody looks at it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Literal

from meshflow.errors import InputError

__all__ = ["Progress", "reporting"]

# Seconds before a bar appears: who waits less needs none.
PATIENCE = 1.0

Progress = Literal[True] | Callable[[float, float], object] | None


@contextmanager
def reporting(progress: Progress, words: str) -> Iterator[Callable[[float], object]]:
    """A function that takes the share done, in [0, 1].

    :param progress: None: nothing; True: a bar on stderr, where that is a terminal, for runs of over a second; a callable: called
        as ``progress(done, total)``, total 1.0. What it raises ends the run.
    """
    if progress is None or progress is False:
        yield lambda share: None
    elif progress is True:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        bar = Bar(*columns, console=console, transient=True, disable=not console.is_terminal)
        task, begun = bar.add_task(words, total=1.0), monotonic()

        def report(share: float) -> None:
            """Show the share that is done, once somebody has waited."""
            bar.update(task, completed=share)
            if monotonic() - begun > PATIENCE and not bar.finished:
                bar.start()  # does nothing once it has begun

        try:
            yield report
        finally:
            bar.stop()
    elif callable(progress):
        yield lambda share: progress(share, 1.0)
    else:
        raise InputError(f"progress: None, True or a callable (done, total) expected, got {progress!r}")
