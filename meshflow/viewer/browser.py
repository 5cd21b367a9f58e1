"""The viewer in a browser: trame serves the page, VTK draws here, and a second thread computes."""

import asyncio
import secrets
import socket
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import replace
from typing import Any

from meshflow.errors import InputError, need
from meshflow.surfaces.data import Data
from meshflow.view.look import Look
from meshflow.viewer.controls import Address, Controls
from meshflow.viewer.curves import curves_as_picture, summary
from meshflow.viewer.guard import Between, OneOf, Rule, Visitors, guard_protocol, guard_requests
from meshflow.viewer.player import Player
from meshflow.viewer.screen import COLOURINGS, Screen
from meshflow.viewer.timeline import Timeline

__all__ = ["Served"]

SETTLE = 0.3  # seconds for which a control must be unchanged before a run starts
POLL = 0.05  # seconds between polls of the computing thread


class Served(Player):
    """A page that shows a timeline.

    :ivar url: its URL with a token. Only requests that know the token are accepted, also on this machine, where pages of other
        sites may be open in the same browser.
    :param desk: the controls.
    :param address: where to listen.
    :raises InputError: for a port that is in use, or an address that does not belong to this machine.
    :raises MissingPackage: without ``meshflow[web]``, and where VTK cannot draw.
    """

    def __init__(self, desk: Controls, timeline: Timeline, look: Look, address: Address) -> None:
        need("trame_pyvista", "web")
        from trame.app import get_server

        self.look, host = look, address.host
        self.host, self.port, self._opened = host, _free(host, address.port), address.opened
        self.token = secrets.token_urlsafe(24)
        shown = "127.0.0.1" if host in ("0.0.0.0", "") else f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{self.port}/?secret={self.token}"
        # A page may have any shape; framed for a square, nothing is cut off where it is wider.
        square = replace(look, size=(min(look.size),) * 2)
        screen = Screen(timeline.at(0), timeline.at(len(timeline) - 1), square, off_screen=True)
        super().__init__(desk, timeline, screen)
        self._server: Any = get_server(f"meshflow-{self.port}", client_type="vue3")
        self._wanted = 0
        self._polling: asyncio.Task[None] | None = None
        self._heard: set[str] = set()
        self._page()

    def serve(self, ready: Callable[[str], None] | None = None) -> None:
        """Serve until interrupted.

        :param ready: called with the URL as soon as the server answers.
        """
        server = self._server
        # trame parses the command line of the process, where it would take --time for its --timeout.
        options = server.cli.parse_args([])
        options.host, options.port, options.authKey, options.timeout = self.host, self.port, self.token, 0
        server.cli.parse_known_args = lambda *_, **__: (options, [])

        def announce(**_: Any) -> None:
            """Report the URL of the page, and open it."""
            if ready is not None:
                ready(self.url)
            if self._opened:
                import webbrowser

                webbrowser.open(self.url)

        server.controller.on_server_bind.add(self._bound)
        server.add_protocol_to_configure(lambda protocol: guard_protocol(protocol, self._rules, self._refused))
        server.controller.on_server_ready.add(announce)
        with closing(self.screen.plotter):
            server.start(open_browser=False, show_connection_info=False, disable_logging=True)
        self._work.leave()

    def _bound(self, server: Any) -> None:
        """Refuse requests of other sites, before the first one."""
        guard_requests(server.app, Visitors(self.host))
        _launched(server)

    def _rules(self) -> dict[str, Rule]:
        """What a client may set: the time, the colours, the controls of the current flow, and the drawer of the page."""
        rules: dict[str, Rule] = {
            "at": Between(0, len(self.timeline) - 1, whole=True),
            "colouring": OneOf(COLOURINGS),
            "main_drawer": OneOf((True, False)),
        }
        for control in self.desk.controls():
            items = control.get("items")
            allowed = Between(control["low"], control["high"]) if items is None else OneOf(tuple(items))
            rules[f"control_{control['name']}"] = allowed
        return rules

    def _refused(self, keys: Iterable[str]) -> None:
        """Reset values that a client may not change; for a control with a message."""
        state, own = self._server.state, self._rules()
        for key in keys:
            if key in own:
                state.message = (
                    f"{key.removeprefix('control_')}: the control cannot have this value; nothing was changed"
                )
            if state.has(key):
                self._server.protocol.clear_state_client_cache(key)
                state.dirty(key)

    def _page(self) -> None:
        """Lay out the page."""
        from trame.ui.vuetify3 import SinglePageWithDrawerLayout
        from trame.widgets import html
        from trame.widgets import vuetify3 as v
        from trame_pyvista.widgets import PyVistaRemoteView

        state = self._server.state
        state.trame__title = self.look.title or "meshflow"
        state.update({"at": len(self.timeline) - 1, "colouring": "surface", "busy": 0, "message": "", "saved": ""})
        self._say()
        with SinglePageWithDrawerLayout(self._server) as layout:
            layout.title.set_text(self.look.title or "meshflow")
            layout.icon.hide()
            layout.footer.hide()
            with layout.toolbar:
                v.VSpacer()
                html.Span("{{ summary }}", id="summary", classes="text-body-2 mr-4")
                with v.VBtnToggle(v_model=("colouring",), density="compact", mandatory=True):
                    for name in COLOURINGS:
                        v.VBtn(name, value=name, size="small", id=f"show_{name}")
            with layout.drawer as drawer:
                drawer.width = 340
                self._drawer(html, v, layout)
            with layout.content, v.VContainer(fluid=True, classes="pa-0 fill-height d-flex flex-column"):
                with html.Div(style="flex:1 1 auto;width:100%;min-height:0", id="picture"):
                    view = PyVistaRemoteView(self.screen.plotter, interactive_ratio=1, still_ratio=1)
                v.VSlider(
                    v_model=("at",),
                    min=0,
                    max=("last",),
                    step=1,
                    label="time",
                    hide_details=True,
                    classes="mx-4 my-1",
                    style="width:95%;flex:0 0 auto",
                    id="time",
                    aria_label="time",
                )
        self._update = view.update
        state.change("at", "colouring")(self._slid)
        self._show_controls()

    def _drawer(self, html: Any, v: Any, layout: Any) -> None:
        with html.Div(classes="pa-3"):
            html.Img(src=("curves",), id="curves", alt="area, and what was removed, over time", style="width:100%")
            v.VProgressLinear(model_value=("busy",), v_show=("busy > 0",), height=6, color="primary", id="busy")
            html.Div("{{ message }}", classes="text-error text-body-2", id="message")
            self._server.ui.controls(layout)
            v.VBtn("save this state", click=self._write, size="small", classes="mt-4", id="save")
            html.Div("{{ saved }}", classes="text-body-2 mt-1", id="saved")
            html.Div("the command for this state:", classes="text-body-2 mt-3")
            html.Pre("{{ command }}", id="command", style="white-space:pre-wrap;word-break:break-all;font-size:11px")

    def _show_controls(self) -> None:
        """Show the controls of the current flow; they depend on the method."""
        from trame.widgets import html
        from trame.widgets import vuetify3 as v

        state, controls = self._server.state, self.desk.controls()
        self._values = {control["name"]: control["value"] for control in controls}
        state.update({f"control_{name}": value for name, value in self._values.items()})
        fresh = set(self._values) - self._heard
        if fresh:
            state.change(*(f"control_{name}" for name in sorted(fresh)))(self._turned)
            self._heard |= fresh
        with self._server.ui.controls as place:
            place.clear()
            for control in controls:
                name, model = control["name"], (f"control_{control['name']}",)
                html.Div(f"{control['label']}: {{{{ {self._shown(control)} }}}}", classes="text-body-2 mt-2")
                if "items" in control:
                    v.VSelect(v_model=model, items=(control["items"],), density="compact", hide_details=True, id=name)
                    continue
                ends = {"min": control["low"], "max": control["high"], "step": control["step"]}
                v.VSlider(v_model=model, hide_details=True, density="compact", id=name, aria_label=name, **ends)

    def _shown(self, control: dict[str, Any]) -> str:
        name = f"control_{control['name']}"
        return name if "items" in control else f"Number({name}).toPrecision(3)"

    def _say(self) -> None:
        state = self._server.state
        state.update({"last": len(self.timeline) - 1, "summary": summary(self.timeline, self.index)})
        state.curves = curves_as_picture(self.timeline, self.index)
        state.command = self.desk.command(self.timeline.history[self.index].time)

    def _slid(self, **_: Any) -> None:
        """The slider was moved, or other colours were chosen."""
        state = self._server.state
        self.colouring = "removed" if state.colouring == "removed" else "surface"
        self.move(int(state.at))

    def _turned(self, **_: Any) -> None:
        """A control was changed; once it rests, a new run begins."""
        values = {name: self._server.state[f"control_{name}"] for name in self._values}
        if values == self._values:
            return
        self._values = values
        self._wanted += 1
        self._task = asyncio.create_task(self._rerun(self._wanted, values))

    async def _rerun(self, wanted: int, values: dict[str, Any]) -> None:
        await asyncio.sleep(SETTLE)
        if wanted == self._wanted:
            with self._server.state as state:
                state.update({"message": "", "saved": ""})
            self._run(values)

    def _write(self) -> None:
        self._server.state.saved = "saving …"
        self.save()

    def _asked(self) -> None:
        if self._polling is None or self._polling.done():
            self._polling = asyncio.create_task(self._polled())

    async def _polled(self) -> None:
        while self._work.kind:
            with self._server.state as state:
                state.busy = max(1, round(100 * self._work.share))
            await asyncio.sleep(POLL)
            with self._server.state:
                self._work.poll()
        with self._server.state as state:
            state.busy = 0

    def _marked(self) -> None:
        self._say()

    def _plotted(self) -> None:
        pass  # the curves are part of the summary of each state

    def _seen(self, data: Data) -> None:
        self.screen.show(data, self.colouring)
        self._update()

    def _failed(self, message: str) -> None:
        self._server.state.message = message

    def _saved(self, message: str) -> None:
        self._server.state.saved = message


def _launched(server: Any) -> None:
    """Answer a page that asks for a launcher of sessions: this server is the session. Otherwise its console shows an error."""
    from aiohttp import web

    async def session(request: Any) -> Any:
        """The address of the only session."""
        scheme = "wss" if request.secure else "ws"
        return web.json_response({"sessionURL": f"{scheme}://{request.host}/ws"})

    server.app.router.add_post("/paraview/", session)


def _free(host: str, port: int) -> int:
    """A port that is free.

    :raises InputError: where the port cannot be used.
    """
    if not 0 <= port <= 65535:
        raise InputError(f"port: 0 to 65535 expected, got {port}")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with closing(socket.socket(family, socket.SOCK_STREAM)) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as cause:
            raise InputError(f"cannot listen at {host}:{port} ({cause.strerror}); name another port or host") from cause
        return int(probe.getsockname()[1])
