"""The interface between windows or pages and the flow that they show."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from meshflow.viewer.timeline import MEMORY, Timeline

__all__ = ["Address", "Controls", "Page", "States"]


@dataclass(frozen=True)
class Address:
    """Where a page is served.

    :param host: address to listen at; only requests that know the token of the URL are accepted.
    :param port: 0: any free port.
    :param opened: open a browser.
    :param said: called with a sentence that names the page's address, as soon as it can be opened.
    """

    host: str = "127.0.0.1"
    port: int = 0
    opened: bool = True
    said: Callable[[str], None] = lambda sentence: None


@dataclass(frozen=True)
class Page:
    """One page that opens offline.

    :param path: where it is written, ``.html``.
    :param overwrite: replace a page that is there.
    """

    path: str | Path
    overwrite: bool = False


@dataclass(frozen=True)
class States:
    """The states of a flow that a viewer shows.

    :param count: how many.
    :param memory: bytes of states that are kept; others are computed again.
    """

    count: int = 32
    memory: int = MEMORY


class Controls(Protocol):
    """The controls of a flow; :class:`meshflow.viewer.session.Desk` has them."""

    def controls(self) -> list[dict[str, Any]]:
        """Numbers have ``name, label, value, low, high, step``, choices ``name, label, value, items``."""
        ...

    def run(self, values: dict[str, Any], gone: Callable[[float], bool]) -> Timeline | None:
        """The states of a flow with these values; None where ``gone``, called with the share done, cancels the run.

        :raises InputError: for invalid values.
        """
        ...

    def shown(self, timeline: Timeline) -> None:
        """Make this run the current one, to which controls, command line and saved states refer."""
        ...

    def command(self, time: float) -> str:
        """The command line that makes the state at a time."""
        ...

    def save(self, time: float) -> str:
        """Write the state at a time; returns a sentence that names the file.

        :raises InputError: where it cannot be saved.
        """
        ...
