"""A command in a forked process: its modules are loaded once, and each costs its work alone."""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

MOST_S = 120.0
"""Of a command; the longest takes some seconds undisturbed, and ten with five others beside it."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: the exit code (minus the signal it died of), what it said, seconds, and
    ``peak_mb`` MB of memory at most; ``hung`` where it had to be ended."""

    code: int
    out: str
    err: str
    seconds: float
    peak_mb: float
    hung: bool = False


@dataclass(frozen=True)
class Running:
    """A command at work."""

    pid: int
    started: float
    files: tuple[Path, Path]

    def signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def said(self) -> str:
        """What it has printed so far."""
        return self.files[0].read_text(encoding="utf-8", errors="replace")

    def ended(self) -> bool:
        """Whether it has ended; what is left of it waits for ``wait()``."""
        state = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        return state in "ZX"

    def wait(self, most_s: float = MOST_S) -> Ended:
        """Wait for its end; kills what takes longer."""
        hung = False
        while True:
            done, status, used = os.wait4(self.pid, os.WNOHANG)
            if done:
                break
            if not hung and time.monotonic() - self.started > most_s:
                hung = True
                os.kill(self.pid, signal.SIGKILL)
            time.sleep(0.005)
        out, err = (path.read_text(encoding="utf-8", errors="replace") for path in self.files)
        for path in self.files:
            path.unlink()
        code = os.waitstatus_to_exitcode(status)
        took = time.monotonic() - self.started
        return Ended(code, out, err, took, used.ru_maxrss / 1024, hung)


_TOLD = {signal.SIGINT, signal.SIGTERM}


def start(
    words: Sequence[str | bytes], before: Callable[[], None] = lambda: None, cwd: Path | None = None
) -> Running:
    """Start ``automap words``; ``before`` is called in its process."""
    sys.stdout.flush()
    sys.stderr.flush()
    handles, files = [], []
    for _ in range(2):
        handle, name = tempfile.mkstemp(prefix="said")
        handles.append(handle)
        files.append(Path(name))
    started = time.monotonic()
    # who is told to end before it has begun is the system's to end: it waits until main() listens
    signal.pthread_sigmask(signal.SIG_BLOCK, _TOLD)
    pid = os.fork()
    if pid:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _TOLD)
        for handle in handles:
            os.close(handle)
        return Running(pid, started, (files[0], files[1]))
    code = 70
    try:
        os.dup2(handles[0], 1)
        os.dup2(handles[1], 2)
        # a background job ignores interrupts, and what it starts does too
        signal.signal(signal.SIGINT, signal.default_int_handler)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False, buffering=1)  # noqa: SIM115
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False, buffering=1)  # noqa: SIM115
        if cwd is not None:
            os.chdir(cwd)
        from pipeline.cli import main, root

        listen = root.interruptible

        def listening() -> None:
            listen()
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _TOLD)

        root.interruptible = listening
        before()
        try:
            main([os.fsdecode(word) for word in words])
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
    except BaseException as error:
        # not a word of the command's: main() ends in an exit code
        os.write(2, f"Traceback of {type(error).__name__}: {error}\n".encode())
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):
                code = 120
        os._exit(code)


def run(words: Sequence[str | bytes], before: Callable[[], None] = lambda: None) -> Ended:
    """Run ``automap words`` to its end."""
    return start(words, before).wait()
