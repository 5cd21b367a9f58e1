"""The viewer in a browser takes orders of its own page alone, and of it only those that its controls can give."""

import asyncio
import base64
import subprocess
import sys
import textwrap
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

from meshflow.surfaces.height_field import HeightField
from meshflow.synthetic.samples import terrain
from meshflow.viewer.curves import curves, curves_as_picture
from meshflow.viewer.guard import Between, OneOf, Visitors, sifted
from meshflow.viewer.timeline import recorded

RULES = {
    "at": Between(0, 4, whole=True),
    "control_scale": Between(0.5, 8.0),
    "colouring": OneOf(("surface", "removed")),
}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("at", 4), ("at", 2.0), ("control_scale", 0.5), ("control_scale", 8.0 + 1e-12), ("colouring", "removed"),
    ],
)  # fmt: skip
def test_a_client_sets_controls_to_what_they_can_have(key, value):
    assert sifted([{"key": key, "value": value}], RULES) == ({key: value}, [])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("at", 5), ("at", -1), ("at", 1.5), ("at", None), ("at", "3"), ("at", True), ("at", float("nan")), ("at", [1]),
        ("control_scale", None), ("control_scale", "nonsense"), ("control_scale", float("inf")), ("control_scale", 1e300),
        ("control_scale", {}), ("colouring", "<img>"), ("colouring", None), ("curves", "<img onerror=alert(1)>"),
        ("command", "rm -rf /"), ("summary", ""), ("saved", ""), ("last", 1), ("control_other", 1.0), ("__proto__", {}),
    ],
)  # fmt: skip
def test_a_client_sets_nothing_else_to_nothing_else(key, value):
    assert sifted([{"key": key, "value": value}], RULES) == ({}, [key])


def test_what_is_no_change_is_left_out():
    for nonsense in (None, 3, "at", {"key": "at"}, [None, 3, "at", {}, {"key": 3, "value": 1}, {"value": 1}]):
        assert sifted(nonsense, RULES) == ({}, [])
    mixed = [{"key": "at", "value": 1}, {"key": "command", "value": ""}, {"key": "at", "value": 3}]
    assert sifted(mixed, RULES) == ({"at": 3}, ["command"])


@pytest.mark.parametrize(
    ("bound", "host", "origin", "let_in"),
    [
        ("127.0.0.1", "127.0.0.1:8080", None, True),
        ("127.0.0.1", "127.0.0.1:8080", "http://127.0.0.1:8080", True),
        ("127.0.0.1", "localhost:9999", "http://localhost:9999", True),  # a port that is forwarded
        ("::1", "[::1]:8080", "http://[::1]:8080", True),
        ("127.0.0.1", "127.0.0.1:8080", "http://evil.example", False),
        ("127.0.0.1", "127.0.0.1:8080", "http://127.0.0.1:9999", False),
        ("127.0.0.1", "127.0.0.1:8080", "null", False),
        ("127.0.0.1", "evil.example:8080", "http://evil.example:8080", False),  # DNS rebinding
        ("127.0.0.1", "192.168.1.5:8080", None, False),
        ("127.0.0.1", None, None, False),
        ("127.0.0.1", "", None, False),
        ("0.0.0.0", "192.168.1.5:8080", "http://192.168.1.5:8080", True),
        ("0.0.0.0", "evil.example:8080", "http://evil.example:8080", False),
        ("0.0.0.0", "192.168.1.5:8080", "http://evil.example", False),
        ("viewer.lab", "viewer.lab:8080", "https://viewer.lab:8080", True),
    ],
)
def test_requests_name_this_machine_and_come_from_its_own_page(bound, host, origin, let_in):
    assert Visitors(bound).lets_in(host, origin) is let_in


def test_curves_are_a_picture_in_which_nothing_runs():
    data = HeightField(np.random.default_rng(0).normal(size=(8, 8)), unit="m")
    timeline = recorded(iter([(0.0, data), (1.0, data)]), lambda time: data, 1.0, "m²", 1 << 20)
    head, packed = curves_as_picture(timeline, 1).split(",")
    assert head == "data:image/svg+xml;base64"
    assert base64.b64decode(packed).decode() == curves(timeline, 1)


def test_no_page_holds_what_a_client_says_as_html():
    for path in (Path(__file__).parents[1] / "meshflow" / "viewer").iterdir():
        if path.suffix in (".py", ".html"):
            text = path.read_text()
            assert "v_html" not in text, path.name
            assert "innerHTML" not in text, path.name


SERVER = """
    import sys
    from pathlib import Path
    from meshflow.estimate.request import Request
    from meshflow.viewer.controls import Address, States
    from meshflow.viewer.session import Saving, view
    import meshflow
    document = meshflow.read(sys.argv[1])
    saving = Saving(sys.argv[1], Path(sys.argv[1]).with_name("saved.npy"), True)
    place = Address("127.0.0.1", 0, False, lambda line: print(line, flush=True))
    view(document, place=place, states=States(4), size=(320, 240), request=Request.of("quick"), saving=saving)
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    path = tmp_path_factory.mktemp("guard") / "hills.npy"
    np.save(path, terrain(32).noisy)
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(SERVER), str(path)], stdout=subprocess.PIPE, text=True
    )
    yield process, process.stdout.readline().split()[0]
    process.terminate()
    process.wait(20)


class Client:
    """A client that speaks wslink: what a script of any page can send."""

    def __init__(self, socket):
        self.socket, self.count = socket, 0

    async def call(self, method, *args, hello=False):
        import aiohttp
        import msgpack
        from wslink.chunking import UnChunker, generate_chunks

        self.count += 1
        name = "system:c0:0" if hello else f"rpc:c0:{self.count}"
        message = {"wslink": "1.0", "id": name, "method": method, "args": list(args), "kwargs": {}}
        for chunk in generate_chunks(msgpack.packb(message), 1 << 20):
            await self.socket.send_bytes(chunk)
        unchunker = UnChunker()
        unchunker.set_max_message_size(1 << 30)
        while True:
            found = await self.socket.receive(timeout=30)
            assert found.type == aiohttp.WSMsgType.BINARY, found
            answer = unchunker.process_chunk(found.data)
            if answer is not None and answer.get("id") == name:
                return answer

    async def state(self):
        return (await self.call("trame.state.get"))["result"]["state"]

    async def set(self, key, value):
        return await self.call("trame.state.update", [{"key": key, "value": value}])

    async def until(self, met):
        for _ in range(150):
            state = await self.state()
            if met(state):
                return state
            await asyncio.sleep(0.2)
        raise AssertionError({key: state[key] for key in ("message", "command", "busy", "at")})


def with_client(url, talk, **headers):
    """What a coroutine makes of a client that is connected, but has not said hello."""

    async def connected():
        import aiohttp

        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"ws://{urlsplit(url).netloc}/ws", headers=headers, max_msg_size=0) as socket,
        ):
            return await talk(Client(socket))

    return asyncio.run(connected())


def token(url):
    (secret,) = parse_qs(urlsplit(url).query)["secret"]
    return secret


@pytest.mark.needs_gl
@pytest.mark.timeout(240)
def test_a_page_of_another_site_is_not_answered(served):
    import aiohttp

    _, url = served
    assert len(token(url)) >= 32

    async def talk(client):
        return await client.call("wslink.hello", {"secret": token(url)}, hello=True)

    for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}, {"Origin": "null"}):
        with pytest.raises(aiohttp.WSServerHandshakeError) as refusal:
            with_client(url, talk, **headers)
        assert refusal.value.status == 403
    assert "result" in with_client(url, talk, Origin=f"http://{urlsplit(url).netloc}")


@pytest.mark.needs_gl
@pytest.mark.timeout(240)
def test_who_does_not_know_the_token_hears_nothing(served):
    _, url = served

    async def talk(client):
        answers = [
            await client.call("wslink.hello", {"secret": word}, hello=True) for word in ("wslink-secret", "", None)
        ]
        return [*answers, await client.call("trame.state.get")]

    assert all("error" in answer for answer in with_client(url, talk))


@pytest.mark.long
@pytest.mark.needs_gl
@pytest.mark.timeout(240)
def test_a_client_turns_controls_and_nothing_else_and_ends_nothing(served):
    process, url = served

    async def talk(client):
        await client.call("wslink.hello", {"secret": token(url)}, hello=True)
        before = await client.state()
        for key, value in (
            ("curves", "<img src=x onerror=alert(1)>"),
            ("command", "rm -rf /"),
            ("summary", "x"),
            ("new", 1),
        ):
            await client.set(key, value)
        after = await client.state()
        for key in ("curves", "command", "summary"):
            assert after[key] == before[key]
        assert "new" not in after
        for nonsense in (None, "nonsense", 1e300, [1]):
            await client.set("control_scale", nonsense)
            found = await client.state()
            assert found["control_scale"] == before["control_scale"]
            assert "scale: the control cannot have this value" in found["message"]
        await client.set("control_scale", before["control_scale"] * 0.9)
        moved = await client.until(lambda state: state["command"] != before["command"] and state["busy"] == 0)
        assert moved["message"] == ""
        await client.set("at", 1)
        await client.until(lambda state: state["summary"] != moved["summary"])
        for method in ("application.exit", "application.exit.later"):
            await client.call(method)
        await client.call("trame.lifecycle.update", "server_bind")
        await asyncio.sleep(1.0)
        return await client.state()

    assert with_client(url, talk)["at"] == 1
    assert process.poll() is None
