"""The library of failing calls: built once, loaded before everything, armed from Python."""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from enum import IntFlag
from hashlib import sha256
from pathlib import Path

SOURCE = Path(__file__).with_name("shim.c")


class Op(IntFlag):
    """Operations of the C library, as in ``shim.c``."""

    WRITE = 1
    SYNC = 2
    RENAME = 4
    READ = 8
    OPEN = 16
    MAKE = 32
    CLOCK = 64

    @classmethod
    def files(cls) -> Op:
        return cls(63)


ONCE, FROM_THEN_ON, SIGNAL, DELAY = range(4)


@dataclass(frozen=True)
class Fault:
    """What happens at an operation: ``how`` and ``what`` as in ``fault_arm()`` of ``shim.c``."""

    ops: Op
    how: int
    what: int


FAULTS: dict[str, Fault] = {
    "disk full": Fault(Op.WRITE, FROM_THEN_ON, errno.ENOSPC),
    "write error": Fault(Op.WRITE, ONCE, errno.EIO),
    "sync error": Fault(Op.SYNC, ONCE, errno.EIO),
    "rename error": Fault(Op.RENAME, ONCE, errno.EIO),
    "read error": Fault(Op.READ, ONCE, errno.EIO),
    "no more handles": Fault(Op.OPEN, ONCE, errno.EMFILE),
    "share gone": Fault(Op.files(), FROM_THEN_ON, errno.ESTALE),
    "slow share": Fault(Op.files(), DELAY, 5),
    "killed at a call": Fault(Op.files(), SIGNAL, signal.SIGKILL),
    "interrupted at a call": Fault(Op.files(), SIGNAL, signal.SIGINT),
    "ended at a call": Fault(Op.files(), SIGNAL, signal.SIGTERM),
    "clock goes back": Fault(Op.CLOCK, ONCE, 3600),
}


def build() -> Path:
    """The library, compiled where it is not yet; raises FileNotFoundError without a compiler."""
    text = SOURCE.read_bytes()
    library = Path(tempfile.gettempdir()) / (
        f"automap-faults-{os.getuid()}-{sha256(text).hexdigest()[:16]}.so"
    )
    if not library.is_file():
        made = library.with_suffix(f".{os.getpid()}")
        subprocess.run(
            [
                "gcc",
                "-O1",
                "-shared",
                "-fPIC",
                "-Wall",
                "-Wextra",
                "-Werror",
                "-o",
                str(made),
                str(SOURCE),
                "-ldl",
            ],
            check=True,
        )
        made.replace(library)
    return library


def environment() -> dict[str, str]:
    """The environment of a process that has the library."""
    root = str(SOURCE.parents[2])
    return {**os.environ, "LD_PRELOAD": str(build()), "PYTHONPATH": root, "PYTHONHASHSEED": "0"}


def with_library(module: str) -> None:
    """Start ``python -m module`` over again with the library in place, unless it is."""
    if "automap-faults" not in os.environ.get("LD_PRELOAD", ""):
        words = [sys.executable, "-m", module, *sys.argv[1:]]
        os.execve(sys.executable, words, environment())


def _library() -> ctypes.CDLL:
    return ctypes.CDLL(os.environ["LD_PRELOAD"])


def arm(folder: Path, ops: Op, how: int = ONCE, what: int = 0, at: int = 0) -> None:
    """From now on count operations below a folder; that of number ``at`` fails."""
    _library().fault_arm(os.fsencode(folder), int(ops), how, what, ctypes.c_long(at))


def seen(ops: Op) -> int:
    """How many operations there were of any of these kinds since the last ``arm()``."""
    return sum(_library().fault_seen(int(op)) for op in Op if op in ops)


def log_to(handle: int) -> None:
    """Write writes (w), syncs (s) and renames (r) as lines of tabs to an open file."""
    _library().fault_log(handle)
