"""The controls of a viewer: the contract between pages and windows and the flow that they show."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from meshflow.viewer.timeline import Timeline

__all__ = ["Address", "Controls"]


@dataclass(frozen=True)
class Address:
    """Where a page is served.

    :param host: address to listen at; only who knows the token of the page's address is let in.
    :param port: 0: any that is free.
    :param opened: a browser is opened.
    """

    host: str = "127.0.0.1"
    port: int = 0
    opened: bool = True


class Controls(Protocol):
    """The controls of a flow; :class:`meshflow.viewer.session.Desk` has them."""

    def controls(self) -> list[dict[str, Any]]:
        """Numbers have ``name, label, value, low, high, step``, choices ``name, label, value, items``."""
        ...

    def run(self, values: dict[str, Any], gone: Callable[[float], bool]) -> Timeline | None:
        """The states of a flow with these values; None where ``gone``, told the share that is done, said to leave it.

        :raises InputError: for values that make no sense.
        """
        ...

    def shown(self, timeline: Timeline) -> None:
        """From now on the states of this run are shown: controls, command line and saved states refer to it."""
        ...

    def command(self, time: float) -> str:
        """The command line that makes the state at a time."""
        ...

    def save(self, time: float) -> str:
        """Write the state at a time; say where.

        :raises InputError: where it cannot be saved.
        """
        ...
