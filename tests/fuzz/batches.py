"""Work in a process of its own, which may die or hang."""

from __future__ import annotations

import os
import pickle
import select
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def in_process(work: Callable[[], Any], folder: Path, seconds: float) -> Any:
    """What ``work`` gives in a fork whose temporary files are in ``folder``; words where it died,
    or was killed after ``seconds``."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        code = 1
        try:
            os.close(reader)
            tempfile.tempdir = str(folder)
            with os.fdopen(writer, "wb") as out:
                pickle.dump(work(), out)
            code = 0
        finally:
            # what the parent shall tidy at its end is not the child's
            os._exit(code)
    os.close(writer)
    told, until = b"", time.monotonic() + seconds
    with os.fdopen(reader, "rb", buffering=0) as source:
        while select.select([source], [], [], max(0.0, until - time.monotonic()))[0]:
            part = source.read(1 << 20)
            if not part:
                break
            told += part
        else:
            os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return pickle.loads(told) if code == 0 else f"exit code {code}"
