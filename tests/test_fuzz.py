"""Whatever a file holds and whatever is asked for: a result, or one line; the process lives.

The default run takes less than a minute; ``pytest -m hour`` takes an hour.
"""

import subprocess
import sys
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent / "helpers" / "fuzz.py"
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="alarms as POSIX has them")


def tried(what, folder, seconds, seed):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), what, str(folder), str(seconds), str(seed)],
        capture_output=True, text=True, errors="replace", cwd=SCRIPT.parents[2],
    )  # fmt: skip
    now = folder / "now.txt"
    last = now.read_text() if done.returncode not in (0, 1) and now.exists() else ""
    assert done.returncode == 0, f"seed {seed}; {last}\n{done.stdout[-8000:]}\n{done.stderr[-2000:]}"


@pytest.mark.long
@pytest.mark.parametrize("what", ["files", "options"])
def test_some_seconds_of_anything(tmp_path, what):
    tried(what, tmp_path, 15, 1)


@pytest.mark.hour
@pytest.mark.timeout(4000)
@pytest.mark.parametrize("what", ["files", "options"])
def test_half_an_hour_of_anything(tmp_path, what):
    tried(what, tmp_path, 1800, int(time.time()))
