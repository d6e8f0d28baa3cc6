"""Asks tests of mistakes, each in a fork of a process that has loaded the heavy libraries.

``python -m tests.mutation.worker FOLDER``: a copy of the project. A line of standard input is
``{"source", "text", "tests", "limit_s"}`` as JSON, the answer ``[state, by]``.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

import numba

_HEAVY = (
    *("numpy", "scipy.optimize", "scipy.linalg", "scipy.spatial", "scipy.stats"),
    *("scipy.special", "scipy.signal", "scipy.ndimage", "pyarrow.parquet", "pydantic", "click"),
    *("pytest", "hypothesis"),
)

_BYTES = 6 << 30
"""Of memory at most: some mistakes make an array grow without end."""


def _load() -> None:
    for name in _HEAVY:
        importlib.import_module(name)


def _ask(root: Path, job: dict[str, Any]) -> tuple[str, str]:
    path = root / job["source"]
    right = path.read_text()
    try:
        write(path, job["text"])
        return _forked(root, job)
    finally:
        write(path, right)


def write(path: Path, text: str) -> None:
    """Have a source say something else from now on."""
    path.write_text(text)
    # python's own compiled files go by size and time to the second
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


def _forked(root: Path, job: dict[str, Any]) -> tuple[str, str]:
    limit_s = job["limit_s"]
    with tempfile.TemporaryFile("w+") as told:
        child = os.fork()
        if child == 0:
            resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
            resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
            signal.alarm(10 * limit_s)  # who waits for ever uses no processor
            if job["compiled"]:
                os.environ["NUMBA_DISABLE_JIT"] = "0"
                numba.config.reload_config()
            _run(root, job["tests"], told.fileno())
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if status in (-signal.SIGKILL, -signal.SIGXCPU, -signal.SIGALRM):
            return "killed", f"took more than {limit_s} s"
        if status == 0:
            return "survived", ""
        told.seek(0)
        lines = told.read().splitlines()
        failed = [s for s in lines if s.startswith(("FAILED", "ERROR"))]
        return "killed", (failed or lines[-1:] or [f"ended with {status}"])[0][:300]


def _run(root: Path, tests: list[str], told: int) -> None:
    os.dup2(told, 1)
    os.dup2(told, 2)
    os.chdir(root)
    for name in [n for n in sys.modules if n.split(".")[0] in ("tests", "automap", "pipeline")]:
        del sys.modules[name]
    import pytest

    options = ["-x", "-q", "--no-header", "--tb=line", "-p", "no:cacheprovider", "-p", "no:xdist"]
    code = 3
    try:
        code = int(pytest.main([*options, *tests]))
    finally:
        sys.stdout.flush()
        os._exit(code)


def main() -> None:
    """Answer until there are no more lines."""
    root = Path(sys.argv[1])
    _load()
    for line in sys.stdin:
        print(json.dumps(_ask(root, json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
