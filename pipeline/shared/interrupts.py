"""What tells a command to end: Ctrl-C, and the signal that asks a process to terminate."""

from __future__ import annotations

import signal
import threading
from typing import Any

told_to_end = threading.Event()
"""Set from the first such signal on. Python raises an exception wherever the process happens to
be, and one that is raised inside a destructor or a callback of a library is lost: a loop that
waits for others looks here too."""


def interrupt(signum: int, frame: Any) -> None:
    told_to_end.set()
    raise KeyboardInterrupt


def interruptible() -> None:
    """Take away what a command has begun when it is told to end, as on Ctrl-C."""
    signal.signal(signal.SIGTERM, interrupt)
    # ignored is what a shell makes it for what runs in the background
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)


def uninterruptible() -> None:
    """All is done, and Python takes a moment to end: what comes now is not to be the exit code."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)
