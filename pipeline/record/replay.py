"""Playing a drive's bytes into pseudo-terminals, as its devices once sent them."""

from __future__ import annotations

import os
import select
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.arrival import read_arrival
from automap.io.atomic import make_folder, write_failure
from automap.io.csv_columns import read_columns
from automap.io.drive import Drive
from automap.records import IntArray
from pipeline.record.append_file import AppendFile
from pipeline.record.imu_format import READINGS

_BITS_PER_BYTE = 10
_SLICE_S = 0.001
_LINKS = {"gnss": "gnss", "imu": "imu"}


@dataclass(frozen=True)
class Feed:
    """Bytes of one device: ``data``, and pieces of it that fall due: first byte [n] and time
    [n] in ns of the drive's clock."""

    name: str
    data: bytes
    offset: IntArray
    t_ns: IntArray


def drive_feeds(drive: Drive) -> list[Feed]:
    """What the receiver and the inertial sensor of a drive sent.

    The receiver's log goes out as it is, at the times of its arrival file; rows of the IMU file
    go out as the lines of the format ``automap-csv`` (``-temp``), each at its own stamp. Raises
    InputError where a drive has neither.
    """
    feeds = []
    if drive.gnss_file is not None and drive.arrival_file is not None:
        data = drive.gnss_file.read_bytes()
        arrival = read_arrival(drive.arrival_file)
        offset, t_ns = arrival.offset, arrival.t_ns
        inside = offset < len(data)
        feeds.append(Feed("gnss", data, offset[inside], t_ns[inside]))
    if drive.imu_file is not None:
        feeds.append(_imu_feed(drive.imu_file))
    if not feeds:
        raise InputError(
            f"{drive.path} has nothing to play: a receiver log with gnss_arrival.csv, or imu.csv."
        )
    return feeds


def _imu_feed(path: Path) -> Feed:
    table = read_columns(
        path, {"t_ns": "int", **dict.fromkeys(READINGS, "text")}, {"temp_c": "text"}
    )
    names = [*READINGS, "temp_c"] if "temp_c" in table.columns else list(READINGS)
    t_ns = np.asarray(table.columns["t_ns"], dtype=np.int64)
    cells = zip(t_ns.tolist(), *(table.columns[name] for name in names), strict=True)
    lines = [(",".join(map(str, row)) + "\r\n").encode() for row in cells]
    offset = np.concatenate([[0], np.cumsum([len(line) for line in lines])[:-1]])
    return Feed("imu", b"".join(lines), offset.astype(np.int64), t_ns)


class Terminal:
    """A pseudo-terminal under a name of our choosing, which a recorder opens as a serial port."""

    def __init__(self, link: Path) -> None:
        """Make it, raw, with ``link`` pointing to it.

        ConfigError where there are none, or where something that is no link is in the way.
        """
        try:
            import pty
            import tty
        except ImportError:
            raise ConfigError(
                "there are no pseudo-terminals on this system; --replay needs Linux or macOS."
            ) from None
        if link.exists() and not link.is_symlink():
            raise ConfigError(f"{link} is in the way of a terminal; name another folder.")
        self.link = link
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.device = os.ttyname(slave)
        # closed here, so that the hang-up tells whether somebody has it open
        os.close(slave)
        os.set_blocking(self._master, False)
        try:
            link.unlink(missing_ok=True)
            link.symlink_to(self.device)
        except OSError as error:
            os.close(self._master)
            raise write_failure(link, error) from error

    @property
    def opened(self) -> bool:
        """Whether a program has the other end open."""
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def write(self, data: bytes | memoryview, patience_s: float = 60.0) -> int:
        """Write what the reader has room for, waiting for room; bytes written."""
        sent = 0
        end = time.monotonic() + patience_s
        while sent < len(data) and time.monotonic() < end:
            try:
                sent += os.write(self._master, data[sent:])
            except BlockingIOError:
                time.sleep(0.001)
            except OSError:
                break
        return sent

    def read(self) -> bytes:
        """What the other end has sent."""
        try:
            return os.read(self._master, 65536)
        except OSError:
            return b""

    def close(self) -> None:
        """Unplug it."""
        # a number that is no descriptor, should another thread still be writing
        master, self._master = self._master, -1
        if master >= 0:
            os.close(master)
        self.link.unlink(missing_ok=True)


@dataclass(frozen=True)
class FeedResult:
    """How a feed went: bytes sent of all, seconds it took, greatest delay behind the plan."""

    name: str
    sent: int
    total: int
    seconds: float
    late_s: float


class Feeder(threading.Thread):
    """Writes one feed into a terminal at its own times and the line's pace.

    Byte k of a piece leaves k * 10 / baud seconds after the piece was due, and never before
    the piece in front of it has left. ``log`` receives ``offset,t_ns,until_ns``: between
    which host times each slice of bytes was handed over.
    """

    def __init__(
        self,
        feed: Feed,
        terminal: Terminal,
        origin_ns: int,
        start_ns: int,
        speed: float = 1.0,
        baud: int = 460_800,
        log: Path | None = None,
    ) -> None:
        """``origin_ns`` of the drive's clock is played at host time ``start_ns``."""
        super().__init__(name=f"feed {feed.name}", daemon=True)
        self.feed = feed
        self.sent = 0
        self.late_s = 0.0
        self.seconds = 0.0
        self._terminal = terminal
        self._origin_ns = origin_ns
        self._start_ns = start_ns
        self._speed = speed
        self._byte_ns = _BITS_PER_BYTE * 1e9 / baud / speed
        self._log = AppendFile(log) if log is not None else None
        self._halt = threading.Event()

    def stop(self) -> None:
        """Make it end soon."""
        self._halt.set()

    def run(self) -> None:
        """Send everything."""
        feed = self.feed
        data = memoryview(feed.data)
        due = self._start_ns + (feed.t_ns - self._origin_ns) / self._speed
        ends = np.append(feed.offset[1:], len(data)).tolist()
        rows = [b"offset,t_ns,until_ns\n"]
        free_ns = 0.0
        begun = time.monotonic_ns()
        for first, end, due_ns in zip(feed.offset.tolist(), ends, due.tolist(), strict=True):
            begin_ns = max(due_ns, free_ns)
            at = first
            while at < end and not self._halt.is_set():
                now = time.monotonic_ns()
                ready = int((now - begin_ns) / self._byte_ns) + 1 if now >= begin_ns else 0
                upto = min(first + ready, end)
                if upto <= at:
                    wait_s = (begin_ns + (at - first) * self._byte_ns - now) * 1e-9
                    # the rest of a piece goes out in slices, as a driver hands it over
                    time.sleep(max(wait_s, _SLICE_S if at > first else 0.0))
                    continue
                self.late_s = max(
                    self.late_s, (now - begin_ns - (at - first) * self._byte_ns) * 1e-9
                )
                sent = self._terminal.write(data[at:upto])
                rows.append(b"%d,%d,%d\n" % (at, now, time.monotonic_ns()))
                self.sent += sent
                if sent < upto - at:
                    self._halt.set()
                at += sent
            free_ns = begin_ns + (end - first) * self._byte_ns
            if self._log is not None and len(rows) > 1000:
                self._log.append(b"".join(rows))
                rows = []
            if self._halt.is_set():
                break
        self.seconds = (time.monotonic_ns() - begun) * 1e-9
        if self._log is not None:
            self._log.append(b"".join(rows))
            self._log.close()

    @property
    def result(self) -> FeedResult:
        """How it went."""
        return FeedResult(self.feed.name, self.sent, len(self.feed.data), self.seconds, self.late_s)


class Replay:
    """The devices of a drive as pseudo-terminals ``gnss`` and ``imu`` in a folder."""

    def __init__(self, feeds: list[Feed], links: Path, baud: int = 460_800) -> None:
        make_folder(links)
        self.feeds = feeds
        self.baud = baud
        self.terminals: dict[str, Terminal] = {}
        try:
            for feed in feeds:
                self.terminals[feed.name] = Terminal(links / _LINKS[feed.name])
        except BaseException:
            self.close()
            raise

    def wait_opened(
        self, timeout_s: float = float("inf"), stop: Callable[[], bool] = lambda: False
    ) -> bool:
        """Wait until a recorder has opened all of them."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end and not stop():
            if all(terminal.opened for terminal in self.terminals.values()):
                return True
            time.sleep(0.05)
        return False

    def play(
        self,
        speed: float = 1.0,
        settle_s: float = 1.0,
        logs: Path | None = None,
        tick: Callable[[float], None] = lambda fraction: None,
    ) -> tuple[list[FeedResult], int, int]:
        """Send everything; results, and which instant of the drive's clock was played at which
        host time."""
        origin = min(int(feed.t_ns[0]) for feed in self.feeds)
        last = max(int(feed.t_ns[-1]) for feed in self.feeds)
        start = time.monotonic_ns() + round(settle_s * 1e9)
        feeders = [
            Feeder(
                feed, self.terminals[feed.name], origin, start, speed, self.baud,
                logs / f"{feed.name}_feed.csv" if logs is not None else None,
            )
            for feed in self.feeds
        ]  # fmt: skip
        for feeder in feeders:
            feeder.start()
        try:
            while any(feeder.is_alive() for feeder in feeders):
                time.sleep(0.1)
                passed = (time.monotonic_ns() - start) * speed
                tick(min(max(passed / max(last - origin, 1), 0.0), 1.0))
        finally:
            for feeder in feeders:
                feeder.stop()
            for feeder in feeders:
                feeder.join(timeout=6.0)
        return [feeder.result for feeder in feeders], origin, start

    def close(self) -> None:
        """Unplug everything."""
        for terminal in self.terminals.values():
            terminal.close()


def copy_rest(drive: Drive, folder: Path, shift_ns: int) -> None:
    """Take a drive's camera files over into a recording of its replay.

    Stamps of frames are moved by ``shift_ns``, host time less the drive's.
    """
    for video in drive.videos.values():
        target = folder / "video"
        target.mkdir(exist_ok=True)
        for path in (*video.chapters, *([video.detections] if video.detections else [])):
            shutil.copyfile(path, target / path.name)
        if video.frames is not None:
            table = read_columns(video.frames, {"frame": "int", "t_ns": "int"})
            rows = zip(table.columns["frame"].tolist(), table.columns["t_ns"].tolist(), strict=True)
            text = "".join(f"{frame},{t_ns + shift_ns}\n" for frame, t_ns in rows)
            path = target / video.frames.name
            path.write_text("frame,t_ns\n" + text, encoding="utf-8", newline="\n")
