"""Tests import `naive`, `helpers` and `peers` by name, from wherever pytest was started."""

import gc
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

# Some two hundred tests start a process: it reads what was compiled, as that of a user does.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

if "PYTEST_XDIST_WORKER" in os.environ:
    # Beside each other the threads of two processes wait for cores by turning in place: four times the work of one process.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="the long tests, too, as continuous integration does")


def pytest_configure(config):
    """Long tests run when they are asked for, and in files that are named."""
    if config.option.long or config.args_source == config.ArgsSource.ARGS:
        config.option.markexpr = config.option.markexpr.removesuffix(" and not long")


def pytest_xdist_auto_num_workers(config):
    """A process for each core for all of the tests; none of its own for measurements and for files that are named."""
    measures = "bench" in config.option.markexpr and "not bench" not in config.option.markexpr
    named = config.args_source == config.ArgsSource.ARGS
    return 0 if measures or named else min(os.cpu_count() or 1, 8)


def pytest_collection_finish():
    """What was imported and collected stays until the end: nobody need look for cycles in half a million objects."""
    gc.collect()
    gc.freeze()
