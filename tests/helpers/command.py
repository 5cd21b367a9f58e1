"""The command in this process: what it prints, and how it ends, without the second that another process takes to start."""

import contextlib
import io
import os
import sys
import warnings
from dataclasses import dataclass
from unittest import mock

from meshflow.cli.commands import main


@dataclass(frozen=True)
class Done:
    """What a command printed, and how it ended."""

    returncode: int
    stdout: str
    stderr: str


def run(*words):
    """``meshflow WORDS``, as a shell has it."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2)]
    code = 0
    with (
        mock.patch.object(sys, "argv", ["meshflow", *map(str, words)]),
        mock.patch.dict(os.environ, {"COLUMNS": "200"}),
        warnings.catch_warnings(),
        contextlib.redirect_stdout(streams[0]),
        contextlib.redirect_stderr(streams[1]),
    ):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    said = []
    for stream in streams:
        stream.flush()
        said.append(stream.buffer.getvalue().decode("utf-8"))
    return Done(code, *said)
