"""Processes of the command that are forked from one in which it is imported: another one starts in hundredths of a second.

What a test says of a process of its own (its pipes, limits, folder, environment, how it ends) holds as it does of one that Python
starts, but for what happens before the command is imported: tests of that start Python.
"""

import gc
import json
import os
import signal
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
SECONDS = 120  # after which a process is ended, as by subprocess.run


def run(*words, cwd=None, stdin=b"", limits=(), start=None, **environment):
    """``meshflow WORDS`` in a process of its own.

    :param stdin: the bytes that it reads.
    :param limits: pairs of a limit of the system and its value.
    :param start: variables with which Python starts.
    :param environment: variables beside those of this process; None: without it.
    """
    started = tuple(sorted((start or {}).items()))
    variables = {**os.environ, "PYTHONPATH": str(ROOT), **dict(started), **environment}
    asked = {
        "words": [os.fsencode(word).hex() for word in words],
        "cwd": os.path.abspath(cwd or os.curdir),
        "limits": list(limits),
        "environment": {name: value for name, value in variables.items() if value is not None},
    }
    pipes = [os.pipe() for _ in range(3)]
    theirs = [pipes[0][0], pipes[1][1], pipes[2][1]]
    server = served(started)
    socket.send_fds(server, [json.dumps(asked).encode()], theirs)
    for end in theirs:
        os.close(end)
    with ThreadPoolExecutor(3) as pool:
        written = pool.submit(_fill, pipes[0][1], stdin)
        stdout, stderr = pool.map(_drain, (pipes[1][0], pipes[2][0]))
        written.result()
    return subprocess.CompletedProcess(words, int(server.recv(64)), stdout, stderr)


@cache
def served(started):
    """The connection to the process that forks, started with these variables; its streams are pipes, as theirs are."""
    ours, theirs = socket.socketpair()
    with theirs:
        subprocess.Popen(
            [sys.executable, __file__, str(theirs.fileno())],
            pass_fds=[theirs.fileno()], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": str(ROOT), **dict(started)},
        )  # fmt: skip
    return ours


def _fill(end, content):
    with open(end, "wb") as pipe:
        try:
            pipe.write(content)
        except BrokenPipeError:
            return  # it ended without reading: its status says why


def _drain(end):
    with open(end, "rb") as pipe:
        return pipe.read()


def serve(connection):
    """Fork a process for each request, until the other end is closed."""
    from meshflow.cli.commands import main

    gc.freeze()  # else a process that ends looks for cycles in all that was imported, and copies its memory for it
    while True:
        message, ends, _, _ = socket.recv_fds(connection, 1 << 20, 3)
        if not message:
            return
        child = os.fork()
        if not child:
            connection.close()
            prepared(json.loads(message), ends)
            main()
            return
        for end in ends:
            os.close(end)
        connection.send(str(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])).encode())


def prepared(asked, ends):
    """Make this process what was asked for."""
    import resource

    for number, end in enumerate(ends):
        os.dup2(end, number)
        os.close(end)
    signal.alarm(SECONDS)
    os.environ.clear()
    os.environ.update(asked["environment"])
    os.chdir(asked["cwd"])
    sys.dont_write_bytecode = bool(asked["limits"])  # no file of Python's may be cut off, too
    for kind, value in asked["limits"]:
        resource.setrlimit(getattr(resource, kind), (value, value))
    sys.argv = ["meshflow", *(os.fsdecode(bytes.fromhex(word)) for word in asked["words"])]


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
