"""Progress: a callback, or a bar on stderr if that is a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Literal

from meshflow.errors import InputError
from meshflow.geometry.validation import shown

__all__ = ["Progress", "reporting"]

# Seconds before a bar appears.
PATIENCE = 1.0

Progress = Literal[True] | Callable[[float, float], object] | None


@contextmanager
def reporting(progress: Progress, words: str) -> Iterator[Callable[[float], object]]:
    """A function that takes the share done, in [0, 1].

    :param progress: None: nothing. True: a bar on stderr, if that is a terminal, for runs longer than a second. A callable: it is
        called as ``progress(done, total)``, with total 1.0; an exception that it raises ends the run.
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
            """Show the share done, after the first second."""
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
        raise InputError(f"progress: None, True or a callable (done, total) expected, got {shown(progress)}")
