"""Files that grow: written at once, synced every second, patient with a full disk."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from automap.io.atomic import make_folder, write_failure

HOLD_BYTES = 64 << 20
"""What is kept in memory per file while the disk takes nothing."""


class AppendFile:
    """A file written at its end. What it holds is always a beginning of what was appended.

    A write that fails (disk full, quota, a card that was pulled) keeps the rest in memory;
    later calls try again, so nothing is lost while it fits into ``hold_bytes``. After that
    ``append`` refuses whole pieces and counts them.
    """

    def __init__(self, path: Path, hold_bytes: int = HOLD_BYTES) -> None:
        """Make the file; StageError when that cannot be done."""
        self.path = path
        self.trouble: str | None = None
        self.refused_bytes = 0
        self.written = 0
        self._hold = hold_bytes
        self._pending = bytearray()
        self._lock = threading.Lock()
        self._unsynced = False
        make_folder(path.parent)
        try:
            self._fd: int | None = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise write_failure(path, error) from error

    @property
    def size(self) -> int:
        """Bytes accepted, on disk or waiting."""
        return self.written + len(self._pending)

    @property
    def waiting(self) -> int:
        """Bytes accepted that the disk has not taken."""
        return len(self._pending)

    def append(self, data: bytes) -> bool:
        """Accept bytes for the end of the file; False when memory for them has run out."""
        if len(self._pending) + len(data) > self._hold:
            self.flush()  # perhaps there is room again
        if len(self._pending) + len(data) > self._hold:
            self.refused_bytes += len(data)
            return False
        self._pending += data
        self.flush()
        return True

    def flush(self) -> bool:
        """Hand what is waiting to the system; False, and ``trouble``, when it does not take it."""
        if self._fd is None:
            return not self._pending
        while self._pending:
            try:
                taken = os.write(self._fd, self._pending)
            except OSError as error:
                self.trouble = str(write_failure(self.path, error)).rstrip(".")
                return False
            if taken:
                del self._pending[:taken]
                self.written += taken
                self._unsynced = True
        self.trouble = None
        return True

    def sync(self) -> None:
        """Wait until what was written is on the disk itself."""
        with self._lock:
            if self._fd is None or not self._unsynced:
                return
            self._unsynced = False
            try:
                os.fsync(self._fd)
            except OSError as error:
                self.trouble = str(write_failure(self.path, error)).rstrip(".")

    def close(self) -> bool:
        """Write, sync and close; False when something could not be written."""
        complete = self.flush()
        self.sync()
        with self._lock:
            if self._fd is not None:
                os.close(self._fd)
                self._fd = None
        return complete and not self.refused_bytes


class ByteLog:
    """Untouched bytes of a port, and which of them arrived when.

    The arrival file has a row for the first byte of each piece read, as
    :func:`automap.io.arrival.read_arrival` takes it; pieces that follow within
    ``merge_ns`` of the last row get none of their own.
    """

    def __init__(self, path: Path, arrival: Path, merge_ns: int = 500_000) -> None:
        self.data = AppendFile(path)
        self.arrival = AppendFile(arrival)
        self.arrival.append(b"offset,t_ns\n")
        self._merge_ns = merge_ns
        self._last_ns: int | None = None

    def append(self, pieces: list[tuple[int, bytes]]) -> None:
        """Write pieces (arrival time, bytes) in their order."""
        rows = []
        taken = []
        offset = self.data.size
        for t_ns, piece in pieces:
            if self._last_ns is None or t_ns - self._last_ns >= self._merge_ns:
                rows.append(b"%d,%d\n" % (offset, t_ns))
                self._last_ns = t_ns
            taken.append(piece)
            offset += len(piece)
        if self.data.append(b"".join(taken)):
            self.arrival.append(b"".join(rows))
        else:
            self._last_ns = None

    @property
    def files(self) -> tuple[AppendFile, AppendFile]:
        """Both files."""
        return self.data, self.arrival
