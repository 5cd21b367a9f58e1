"""Access control of the served viewer: which requests are accepted, and what a client may set.

A page of another site that is open in the same browser can reach loopback, too. Therefore a request must name this machine as its
host, and its origin, if any, must be the page itself. A client must know the token of the URL. It may set the controls of the
page to valid values, and nothing else.
"""

import ipaddress
import logging
import math
import socket
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from aiohttp.web import Application, Request, StreamResponse

__all__ = ["LOOPBACK", "Between", "OneOf", "Rule", "Visitors", "guard_protocol", "guard_requests", "sifted"]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
# The life-cycle events that the page itself may send.
STAGES = ("client_connected", "client_exited", "client_mounted", "client_unmounted")
HEADERS = {"Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY", "X-Content-Type-Options": "nosniff"}
_log = logging.getLogger(__name__)


class Rule(Protocol):
    """The valid values of a control."""

    def accepts(self, value: object) -> bool:
        """Whether a value is valid."""
        ...


@dataclass(frozen=True)
class Between:
    """Finite numbers from low to high, with tolerance for the rounding of a slider.

    :param whole: whole numbers only.
    """

    low: float
    high: float
    whole: bool = False

    def accepts(self, value: object) -> bool:
        """Whether a value is such a number."""
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return False
        slack = 1e-9 * max(abs(self.low), abs(self.high), 1e-300)
        return self.low - slack <= value <= self.high + slack and (not self.whole or value == round(value))


@dataclass(frozen=True)
class OneOf:
    """One of some values."""

    values: tuple[object, ...]

    def accepts(self, value: object) -> bool:
        """Whether a value is one of them, with the same type."""
        return any(type(value) is type(one) and value == one for one in self.values)


def sifted(changes: object, rules: Mapping[str, Rule]) -> tuple[dict[str, object], list[str]]:
    """The changes of the state that a client may make, and the keys of the others.

    :param changes: of a client: a list of ``{"key": ..., "value": ...}``; anything else is ignored.
    :param rules: the keys that a client may set, and their values.
    """
    accepted: dict[str, object] = {}
    refused: list[str] = []
    for change in changes if isinstance(changes, list) else []:
        key = change.get("key") if isinstance(change, dict) else None
        if not isinstance(key, str):
            continue
        rule, value = rules.get(key), change.get("value")
        if rule is not None and rule.accepts(value):
            accepted[key] = value
        else:
            refused.append(key)
    return accepted, refused


@dataclass(frozen=True)
class Visitors:
    """Which requests are accepted.

    :param bound: the address of the server.
    """

    bound: str

    def lets_in(self, host: str | None, origin: str | None) -> bool:
        """Whether a request with this host and origin is meant for this server.

        A name that an attacker has pointed at this machine (DNS rebinding) is not accepted. Any port is accepted, because ports
        may be forwarded.
        """
        if host is None or not self._is_own(urlsplit(f"//{host}").hostname):
            return False
        return origin is None or urlsplit(origin).netloc == host

    def _is_own(self, name: str | None) -> bool:
        if name is None:
            return False
        if name in LOOPBACK or self.bound in LOOPBACK:
            return name in LOOPBACK
        if name in (self.bound.lower(), socket.gethostname().lower(), socket.getfqdn().lower()):
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:  # a name that is not that of this machine
            return False
        return True


def guard_requests(app: "Application", visitors: Visitors) -> None:
    """Refuse requests of other hosts and origins, including WebSockets; call it before the application starts."""
    from aiohttp import web

    @web.middleware
    async def only_own(
        request: "Request", handler: "Callable[[Request], Awaitable[StreamResponse]]"
    ) -> "StreamResponse":
        """Answer 403 to a request that is not meant for this server."""
        if not visitors.lets_in(request.headers.get("Host"), request.headers.get("Origin")):
            raise web.HTTPForbidden(text="This viewer answers to its own address only.")
        response = await handler(request)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    app.middlewares.append(only_own)


def guard_protocol(
    protocol: object, rules: Callable[[], Mapping[str, Rule]], refused: Callable[[Iterable[str]], None]
) -> None:
    """Make a trame protocol accept only what clients may set, and no command to end the process.

    trame makes its protocol from a fixed class; its remote procedures are those of the class of the object when the server binds.
    Therefore the object gets a class that overrides them.

    :param protocol: a ``trame_server.protocol.CoreServer`` during its configuration.
    :param rules: what a client may currently set.
    :param refused: called with the keys that it may not set.
    """
    from wslink import register

    kind: type = type(protocol)

    class Guarded(kind):
        """The protocol of trame with fewer rights for clients."""

        @register("trame.state.update")
        def update_state(self, changes: object) -> None:
            """Accept what a client may set; the rest is not sent to other clients."""
            accepted, others = sifted(changes, rules())
            if others:
                _log.warning("refused from a client: %s", ", ".join(sorted(others)))
                with self.server.state:
                    refused(others)
            if accepted:
                super().update_state([{"key": key, "value": value} for key, value in accepted.items()])

        @register("trame.lifecycle.update")
        def life_cycle_update(self, name: object) -> None:
            """Accept the life-cycle events of a page only."""
            if name in STAGES:
                super().life_cycle_update(name)

        @register("application.exit")
        def exit(self, *_: object) -> None:
            """A page does not end the process; Ctrl-C does."""
            _log.warning("refused from a client: application.exit")

        @register("application.exit.later")
        def exitLater(self, *_: object) -> None:  # noqa: N802 - the name in wslink
            """A page does not end the process; Ctrl-C does."""
            _log.warning("refused from a client: application.exit.later")

    protocol.__class__ = Guarded
