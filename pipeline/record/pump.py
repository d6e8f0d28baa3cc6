"""A process that does nothing but read one port and stamp what it reads.

In a process of its own nothing else of the recorder can keep it waiting. It is run as a
script with the number of an open file descriptor, and ``fresh`` where what lies in the driver is
to be forgotten. It writes frames (host time, length, bytes) to its output, an empty one when it is
ready, and ends when the port has gone or its input closes (the recorder ended, in whatever way).
It imports nothing of AutoMap, so that it starts at once.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import struct
import sys
import time

FRAME = struct.Struct("<qI")
_READ_BYTES = 65536


def raise_priority() -> None:
    """Let this thread run before others, as far as the system allows it."""
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(5))
        return
    with contextlib.suppress(OSError):
        os.nice(-10)


def _send(t_ns: int, data: bytes) -> None:
    frame = memoryview(FRAME.pack(t_ns, len(data)) + data)
    while frame:
        frame = frame[os.write(1, frame) :]


def pump(fd: int, fresh: bool) -> None:
    """Copy until the port or the recorder has gone."""
    raise_priority()
    gc.disable()
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    poll.register(0, select.POLLIN)
    if fresh and any(number == fd for number, _ in poll.poll(0)):
        # what came while everything was being set up is older than its stamp would say; nobody
        # but who reads may drop it, or a hole is left between two readings
        with contextlib.suppress(OSError):
            os.read(fd, _READ_BYTES)
    _send(time.monotonic_ns(), b"")
    ending = False
    while True:
        ready = poll.poll(0 if ending else None)
        t_ns = time.monotonic_ns()
        if any(number == fd for number, _ in ready):
            try:
                data = os.read(fd, _READ_BYTES)
            except BlockingIOError:
                continue
            if not data:
                return
            _send(t_ns, data)
        elif ending:
            return
        elif ready:
            # the recorder ends: what lies in the driver's buffer was sent before that
            ending = True
            poll.unregister(0)


if __name__ == "__main__":
    with contextlib.suppress(OSError, KeyboardInterrupt):
        pump(int(sys.argv[1]), "fresh" in sys.argv[2:])
