"""The viewer in a browser: the page loads, the slider moves, the picture changes, and the console holds no error."""

import io
import shutil
import socket
import subprocess
import sys
import textwrap

import numpy as np
import PIL.Image
import pytest

from meshflow.errors import InputError, need
from meshflow.synthetic.samples import terrain
from meshflow.viewer.browser import Served, _free
from meshflow.viewer.controls import Address

pytestmark = [pytest.mark.needs_gl, pytest.mark.timeout(240)]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with need("playwright.sync_api", "test").sync_playwright() as player:
        chromium = player.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def page(browser):
    opened = browser.new_page(viewport={"width": 1000, "height": 700})
    opened.errors = []
    opened.on("console", lambda message: opened.errors.append(message.text) if message.type == "error" else None)
    opened.on("pageerror", lambda error: opened.errors.append(str(error)))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def raster(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "hills.npy"
    np.save(path, terrain(48).noisy)
    return path


def test_a_page_that_is_exported_opens_offline_and_its_slider_moves_the_picture(tmp_path, page, raster):
    target = tmp_path / "page.html"
    command = ["view", str(raster), "--export", str(target), "--frames", "5", "--no-search", "--title", "</script>&"]
    subprocess.run([sys.executable, "-m", "meshflow", *command], check=True)
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(target.as_uri())
    page.wait_for_function("document.body.dataset.ready || document.getElementById('failed').textContent")
    assert page.inner_text("#failed") == ""
    assert page.inner_text("h1") == "</script>&"
    assert all(url.startswith("file:") or url.startswith("blob:") for url in requests)
    first, words = page.locator("#canvas").screenshot(), page.inner_text("#summary")
    with PIL.Image.open(io.BytesIO(first)) as seen:
        rows, columns = np.nonzero(np.asarray(seen.convert("L")) < 250)
        high, wide = seen.height, seen.width
    left, right, above, below = columns.min(), wide - 1 - columns.max(), rows.min(), high - 1 - rows.max()
    assert min(left, right, above, below) > 0.01 * high  # all of it is seen, in the middle
    assert abs(int(left) - int(right)) < 0.05 * wide
    assert abs(int(above) - int(below)) < 0.05 * high
    page.locator("#time").focus()
    page.keyboard.press("Home")
    assert page.inner_text("#summary").startswith("time 0")
    assert page.inner_text("#summary") != words
    second = page.locator("#canvas").screenshot()
    page.check("#removed")
    third = page.locator("#canvas").screenshot()
    page.mouse.move(650, 350)
    page.mouse.down()
    page.mouse.move(720, 380, steps=3)
    page.mouse.up()
    assert len({first, second, third, page.locator("#canvas").screenshot()}) == 4
    assert page.inner_text("#command").startswith("meshflow smooth")
    assert page.errors == []


SERVER = """
    import sys
    from pathlib import Path
    from meshflow.estimate.request import Request
    from meshflow.flow.compute import Compute
    from meshflow.viewer.controls import Address, States
    from meshflow.viewer.session import Saving, view
    import meshflow
    document = meshflow.read(sys.argv[1])
    saving = Saving(sys.argv[1], Path(sys.argv[1]).with_name("saved.npy"), True)
    place = Address(sys.argv[2], 0, False, lambda line: print(line, flush=True))
    request = Request.of(compute=Compute(search=False))
    view(document, place=place, states=States(5, 1), size=(400, 300), request=request, saving=saving)
"""


@pytest.fixture(scope="module")
def served(raster, request):
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(SERVER), str(raster), request.param], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    yield process.stdout.readline().split()[0]
    process.terminate()
    process.wait(20)


@pytest.mark.parametrize("served", ["127.0.0.1"], indirect=True)
def test_in_a_browser_the_slider_moves_and_a_control_computes_again(page, served):
    assert "?secret=" in served
    page.goto(served)
    page.wait_for_selector("#picture img", timeout=60_000)
    page.wait_for_function("document.querySelector('#summary').textContent.startsWith('time ')")
    page.wait_for_timeout(1000)
    pictures, words = [page.locator("#picture").screenshot()], [page.inner_text("#summary")]
    for keys, to in (
        (["Home"], "main [role=slider]"),
        (["ArrowLeft"] * 4, "nav [role=slider]"),
        (["End"], "main [role=slider]"),
    ):
        page.locator(to).first.focus()
        for key in keys:
            page.keyboard.press(key)
        before = words[-1]
        if "nav" in to:
            page.wait_for_function("document.querySelector('#command').textContent.length > 0")
            page.wait_for_timeout(2500)
        else:
            page.wait_for_function("before => document.querySelector('#summary').textContent !== before", arg=before)
            page.wait_for_timeout(1000)
        words.append(page.inner_text("#summary"))
        pictures.append(page.locator("#picture").screenshot())
    assert words[1].startswith("time 0 ")
    assert words[3] != words[0]  # the time at the end is another one
    assert pictures[0] != pictures[1]
    assert page.inner_text("#message") == ""
    assert page.errors == []


@pytest.mark.parametrize("served", ["127.0.0.1"], indirect=True)
def test_in_a_browser_what_is_let_go_is_computed_again_and_saving_waits_for_the_run(page, served, raster):
    page.goto(served)
    page.wait_for_selector("#picture img", timeout=60_000)
    page.wait_for_function("document.querySelector('#summary').textContent.startsWith('time ')")
    page.wait_for_timeout(1000)
    last = page.locator("#picture").screenshot()
    page.locator("main [role=slider]").first.focus()
    page.keyboard.press("ArrowLeft")  # memory is for the first and the last state alone
    page.wait_for_timeout(2500)
    assert page.locator("#picture").screenshot() != last
    page.locator("nav [role=slider]").first.focus()
    page.keyboard.press("ArrowLeft")
    page.wait_for_timeout(500)  # the run has begun, or has just ended
    page.click("#save")
    page.wait_for_function("document.querySelector('#saved').textContent.startsWith('written: ')", timeout=60_000)
    assert np.load(raster.with_name("saved.npy")).shape == np.load(raster).shape
    page.wait_for_function("getComputedStyle(document.querySelector('#busy')).display === 'none'")
    assert page.inner_text("#message") == ""
    assert page.errors == []


@pytest.mark.long
@pytest.mark.parametrize("served", ["0.0.0.0", "127.0.0.1"], indirect=True)
def test_nobody_sees_anything_without_the_token(page, served):
    assert "?secret=" in served
    page.goto(served.split("?")[0])
    page.wait_for_timeout(1500)
    assert page.query_selector("#picture img") is None
    page.goto(served)
    page.wait_for_selector("#picture img", timeout=60_000)


@pytest.mark.long
def test_a_port_that_is_taken_is_refused_by_name():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"cannot listen at 127.0.0.1:{port}"):
            _free("127.0.0.1", port)
    with pytest.raises(InputError, match="port: 0 to 65535"):
        Served(None, None, None, Address(port=70000))
