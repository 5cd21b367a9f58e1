"""What a viewer turns, whoever it is: the contract between the pages and windows here and the flow that they show."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from meshflow.viewer.timeline import Timeline

__all__ = ["Address", "Dials"]


@dataclass(frozen=True)
class Address:
    """Where a page is served.

    :param host: address to listen at; beyond loopback only who knows the token of the address is let in.
    :param port: 0: any that is free.
    :param opened: a browser is opened.
    """

    host: str = "127.0.0.1"
    port: int = 0
    opened: bool = True


class Dials(Protocol):
    """What is turned; :class:`meshflow.viewer.session.Desk` is one."""

    def controls(self) -> list[dict[str, Any]]:
        """Knobs: ``name, label, value, low, high, step`` each; of a choice ``name, label, value, items``."""
        ...

    def run(self, values: dict[str, Any], gone: Callable[[float], bool]) -> Timeline | None:
        """The states of a flow with these values; None where ``gone``, told the share that is done, said to leave it.

        :raises InputError: for values that make no sense.
        """
        ...

    def shown(self, timeline: Timeline) -> None:
        """The states of a run are what is seen from now on: what knobs, command line and saved states are of."""
        ...

    def command(self, time: float) -> str:
        """The command line that makes the state at a time."""
        ...

    def save(self, time: float) -> str:
        """Write that state; where to.

        :raises InputError: where it cannot be saved.
        """
        ...
