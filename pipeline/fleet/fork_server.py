"""A process from which each drive's process is forked: ``python -m pipeline.fleet.fork_server``.

To import what a drive needs and to load its compiled kernels takes as long as to map a minute of
driving. The server does that once: the first drive's process says what it has imported and
compiled, and those after it begin with that, otherwise as empty as a new process. It reads the
path of a request a line, and says the process's id, then how that ended.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pipeline.shared.kernel_cache import ensure_kernel_cache

_THREADS = ("OPENBLAS", "OMP", "MKL", "NUMEXPR", "NUMBA", "ARROW_IO", "OPENCV_FOR")
_NEEDED = "needed.pickle"
_STARTS_THREADS = "onnxruntime"
"""It does so as it is imported, and a thread does not live on in a process that is forked.
Arrow's allocator has one too, and begins it anew there."""
LOG = "log"


class ForkServer:
    """The worker's end."""

    def __init__(self) -> None:
        ensure_kernel_cache()
        own = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
        # as the command line has it, wherever a scheduler began this worker
        own["NUMPY_MADVISE_HUGEPAGE"] = "0"
        self._process = subprocess.Popen(
            [sys.executable, "-m", "pipeline.fleet.fork_server"], bufsize=0,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**os.environ, **own},
        )  # fmt: skip
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout

    def run(self, request: Path, look: Callable[[int], None], every_s: float) -> int:
        """The exit code of the process of a request, negative for a signal; ``look`` is given its
        id so often. Where the server is gone it is as if the process had been killed. What it
        prints goes to LOG beside the request."""
        try:
            self._to.write(f"{request}\n".encode())
        except BrokenPipeError:
            return self._lost()
        pid: int | None = None
        while True:
            ready, _, _ = select.select([self._from], [], [], every_s)
            line = self._from.readline() if ready else None
            if line == b"":
                return self._lost()
            if line and pid is not None:
                return int(line)
            if line:
                pid = int(line)
            elif pid is not None:
                look(pid)

    def _lost(self) -> int:
        self.end()
        return -signal.SIGKILL

    def end(self) -> None:
        """End it, and with it what it has forked."""
        self._process.kill()
        self._process.wait()
        # a drive's process ends where nobody holds the other end of its input
        self._to.close()
        self._from.close()

    def runs(self) -> bool:
        """Whether it can take a request."""
        return self._process.poll() is None


_idle: list[ForkServer] = []


@contextmanager
def fork_server() -> Iterator[ForkServer]:
    """One that nobody uses just now; it stays for the next drive unless this one is interrupted."""
    server = _waiting() or ForkServer()
    try:
        yield server
    except BaseException:
        server.end()
        raise
    _idle.append(server)


def _waiting() -> ForkServer | None:
    # threads take them at the same time
    with suppress(IndexError):
        while True:
            server = _idle.pop()
            if server.runs():
                return server
            server.end()
    return None


def end_idle() -> None:
    """End those that wait."""
    while server := _waiting():
        server.end()


def _line() -> str:
    """A line of the input, of which nothing more is read: the processes forked watch it too."""
    read = b""
    while not read.endswith(b"\n"):
        byte = os.read(0, 1)
        if not byte:
            return ""
        read += byte
    return read.decode().strip()


def _serve() -> None:
    """Fork a process for each request, until the worker ends."""
    while request := _line():
        pid = os.fork()
        if pid == 0:
            _drive(Path(request))
        os.write(1, f"{pid}\n".encode())
        _, status = os.waitpid(pid, 0)
        needed = Path(request).parent / _NEEDED
        if needed.is_file():
            # in a folder into which only this user writes
            _take(*pickle.loads(needed.read_bytes()))
        os.write(1, f"{os.waitstatus_to_exitcode(status)}\n".encode())


def _drive(request: Path) -> None:
    """The process of a drive: answer the request and end."""
    code = 1
    try:
        with (request.parent / LOG).open("wb") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        before = set(sys.modules)
        from pipeline.fleet.child import answer

        answer(request)
        (request.parent / _NEEDED).write_bytes(pickle.dumps(_needed(before)))
        code = 0
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        # what the server would do at its end is not this process's
        os._exit(code)


def _needed(before: set[str]) -> tuple[list[str], list[tuple[str, str, list[Any]]]]:
    """Modules imported since ``before``, and kernels with the types that they were called with."""
    from numba.core.dispatcher import Dispatcher

    modules = [
        name for name in sys.modules if name not in before and not name.startswith(_STARTS_THREADS)
    ]
    kernels = {
        id(kernel): (module, name, list(kernel.signatures))
        for module, content in sys.modules.items()
        if module.startswith("automap.")
        for name, kernel in vars(content).items()
        if isinstance(kernel, Dispatcher) and kernel.signatures
    }
    return modules, list(kernels.values())


def _take(modules: list[str], kernels: list[tuple[str, str, list[Any]]]) -> None:
    """Import modules and load kernels; what cannot be had now the next process does itself."""
    import importlib

    for name in modules:
        with suppress(Exception):
            importlib.import_module(name)
    for module, name, signatures in kernels:
        for signature in signatures:
            with suppress(Exception):
                getattr(sys.modules[module], name).compile(signature)


if __name__ == "__main__":
    _serve()
