"""Read many files with one start of Python: a server with loaded libraries forks a helper process for each file.

`pliant.recording.apart` starts a fresh interpreter for each file. This module reads each file by the same function of
the same worker, in a separate process with the same limits of time and memory; only the start of Python is shared.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pliant.recording import apart

SERVER = """
import json, os, signal, sys, time
sys.path.insert(0, sys.argv[1])
import pliant
del sys.path[0]
from importlib import import_module
from pliant.recording import apart_worker
for module in apart_worker.READ.values():
    import_module(module)
for line in sys.stdin:
    kind, path, seconds, memory, named, wait, answer = json.loads(line)
    child = os.fork()
    if child == 0:
        try:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            with open(answer, "wb") as out:
                apart_worker.answer_to(out, kind, path, seconds, memory, named)
            os._exit(0)
        finally:
            os._exit(1)
    until = time.monotonic() + wait
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.0005)
    print(json.dumps([os.waitstatus_to_exitcode(ended[1]), time.monotonic() > until]), flush=True)
"""


@contextmanager
def forked() -> Iterator[None]:
    """Make `pliant.recording.apart` fork its helper processes from one server within this context."""
    command = [sys.executable, "-P", "-c", SERVER, apart.SOURCES]
    before = apart.run_helper
    with (
        tempfile.TemporaryDirectory() as name,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                         env={**apart.os.environ, **apart.ENVIRONMENT}) as server,
    ):  # fmt: skip
        answer = Path(name) / "answer"

        def run(kind: str, path: Path, seconds: int, memory: int, named: Sequence[str]) -> tuple[int, bytes]:
            answer.write_bytes(b"")
            wait = apart.WAIT_FACTOR * seconds
            request = [kind, str(path.resolve()), seconds, memory, [*named], wait, str(answer)]
            server.stdin.write(json.dumps(request) + "\n")
            server.stdin.flush()
            code, late = json.loads(server.stdout.readline())
            if late:
                raise subprocess.TimeoutExpired(kind, wait)
            return code, answer.read_bytes()

        apart.run_helper = run
        try:
            yield
        finally:
            apart.run_helper = before
            server.stdin.close()
