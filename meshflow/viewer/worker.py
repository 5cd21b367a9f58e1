"""Work in a second thread, so that a window stays responsive: the last request of a kind replaces earlier ones."""

from collections.abc import Callable
from dataclasses import dataclass
from threading import Thread
from typing import Any

from meshflow.errors import InputError, MissingPackage

__all__ = ["Background", "Gone"]

Gone = Callable[[float], bool]
"""Told the share that is done; True: nobody waits for it any more."""


@dataclass(frozen=True, eq=False)
class _Task:
    """Work that was asked for, and who hears what became of it."""

    kind: str
    work: Callable[[Gone], Any]
    done: Callable[[Any], None]
    failed: Callable[[str], None]


class Background:
    """Runs one task after the other; of each kind, the last that was asked for.

    There is one thread, never two: what is computed there runs on all cores as it is.

    :ivar share: of the work that is going on, 0 to 1, as far as it says.
    """

    def __init__(self) -> None:
        self.share = 0.0
        self._waiting: dict[str, _Task] = {}
        self._running: _Task | None = None
        self._left = False
        self._outcome: tuple[Any, str] | None = None

    @property
    def kind(self) -> str:
        """The kind of work that is going on; empty: none."""
        return "" if self._running is None else self._running.kind

    def ask(
        self, kind: str, work: Callable[[Gone], Any], done: Callable[[Any], None], failed: Callable[[str], None]
    ) -> None:
        """Do this as soon as nothing else is done, in place of what of its kind was asked for before.

        :param done: called by :meth:`poll`, in its thread, with what ``work`` gave.
        :param failed: the same, with the message of an error.
        """
        self._waiting[kind] = _Task(kind, work, done, failed)
        self._left = self._left or self.kind == kind
        if self._running is None:
            self._begin()

    def leave(self) -> None:
        """Cancel all work."""
        self._waiting.clear()
        self._left = True

    def poll(self) -> None:
        """Deliver what is done, and start what waits."""
        if self._outcome is None or self._running is None:
            return
        task, (result, message), left = self._running, self._outcome, self._left
        self._running = self._outcome = None
        if not left:
            task.failed(message) if message else task.done(result)
        if self._running is None and self._waiting:  # a callback may have added work
            self._begin()

    def _begin(self) -> None:
        task = self._waiting.pop(next(iter(self._waiting)))
        self._running, self._left, self.share = task, False, 0.0
        Thread(target=self._run, args=(task,), daemon=True).start()

    def _run(self, task: _Task) -> None:
        def gone(share: float) -> bool:
            """Note how far the work is; whether nobody waits for it."""
            self.share = share
            return self._left

        try:
            outcome = task.work(gone), ""
        except (InputError, MissingPackage, RuntimeError, OSError) as cause:
            outcome = None, str(cause) or type(cause).__name__
        except Exception as cause:  # noqa: BLE001 - or the thread would end, and the window wait for it for ever
            outcome = None, f"{type(cause).__name__}: {cause}"
        self._outcome = outcome
