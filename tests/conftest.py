"""Tests import `naive`, `helpers` and `peers` by name, from wherever pytest was started.

Compiled code is kept apart for each state of the sources: numba looks at the file of a loop, not at the formulas it calls.
"""

import hashlib
import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

if "PYTEST_XDIST_WORKER" in os.environ:
    # Beside each other the threads of two processes wait for cores by turning in place: four times the work of one process.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")

if "NUMBA_CACHE_DIR" not in os.environ:
    # What is compiled is in these rooms.
    rooms = (Path(__file__).parents[1] / "meshflow" / room for room in ("geometry", "flow"))
    sources = sorted(path for room in rooms for path in room.rglob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / f"meshflow-numba-{digest}")


def pytest_xdist_auto_num_workers(config):
    """A process for each core for all of the tests; none of its own for measurements and for files that are named."""
    measures = "bench" in config.option.markexpr and "not bench" not in config.option.markexpr
    named = config.args_source == config.ArgsSource.ARGS
    return 0 if measures or named else min(os.cpu_count() or 1, 8)
