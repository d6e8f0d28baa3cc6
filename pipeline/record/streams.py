"""From the pieces of a port to the files of the drive, and to what watches them."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path

from pipeline.record.append_file import AppendFile, ByteLog
from pipeline.record.clock import DeviceClock
from pipeline.record.gnss_watch import GnssState, GnssWatch
from pipeline.record.imu_decode import ImuDecoder, Sample
from pipeline.record.imu_format import READINGS, ImuFormat
from pipeline.record.imu_watch import ImuState, ImuWatch
from pipeline.record.messages import Message, MessageStream
from pipeline.record.reader import Event, PortReader


class GnssStream:
    """A receiver's log with its arrival times; messages also go to whoever is asking."""

    def __init__(self, folder: Path, reader: PortReader, watch: GnssWatch, event: Event) -> None:
        self.reader = reader
        self.watch = watch
        self.lock = threading.Lock()  # over what the writer changes and the view reads
        self.log = ByteLog(folder / "gnss.ubx", folder / "gnss_arrival.csv")
        self.messages = MessageStream()
        self._inbox: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._asking = False
        self._view = _Guard("gnss", event)

    @property
    def files(self) -> tuple[AppendFile, ...]:
        """The files that grow."""
        return self.log.files

    def drain(self) -> None:
        """Write what came in since the last call."""
        pieces = self.reader.take()
        self.log.append([(t, data) for t, data in pieces if data])
        with self.lock:
            self._view.run(lambda: self._watch(pieces))

    def _watch(self, pieces: list[tuple[int, bytes | None]]) -> None:
        for t_ns, data in pieces:
            if data is None:
                self.messages.restart()
                continue
            self.watch.count_bytes(t_ns, len(data))
            for message in self.messages.feed(t_ns, data):
                self.watch.take(message)
                if self._asking:
                    self._inbox.put(message)

    def state(self, now_ns: int) -> GnssState:
        """The receiver as of now."""
        with self.lock:
            return self.watch.update(now_ns)

    def conditions(self, now_ns: int, started_ns: int, baud: int | None) -> dict[str, str]:
        """What is wrong now; ``baud`` None where the line has no rate of its own."""
        with self.lock:
            return self.watch.conditions(now_ns, started_ns, self.reader.last_byte_ns, baud)

    def forgot(self, now_ns: int) -> bool:
        """Whether the receiver has lost its settings."""
        with self.lock:
            return self.watch.forgot(now_ns)

    def exchange(
        self, data: bytes, accept: Callable[[Message], bool], timeout_s: float
    ) -> Message | None:
        """Send bytes and wait for a message; called from a thread other than the writer's."""
        while not self._inbox.empty():
            self._inbox.get_nowait()
        self._asking = True
        try:
            self.reader.write(data)
            end = time.monotonic() + timeout_s
            while (left := end - time.monotonic()) > 0:
                try:
                    message = self._inbox.get(timeout=left)
                except queue.Empty:
                    return None
                if accept(message):
                    return message
            return None
        finally:
            self._asking = False


class ImuStream:
    """An inertial sensor: its untouched bytes, and ``imu.csv`` decoded from them.

    ``t_ns`` in ``imu.csv`` is the arrival of a line's first byte, or the device's own clock
    brought to the host's (see :class:`DeviceClock`) where it has one; ``device_ns`` is then
    that clock as it was.
    """

    def __init__(self, folder: Path, reader: PortReader, form: ImuFormat, event: Event) -> None:
        self.reader = reader
        self.lock = threading.Lock()
        self.form = form
        self.watch = ImuWatch(form)
        self.clock = DeviceClock()
        self.decoder = ImuDecoder(form)
        self.log = ByteLog(folder / "imu.raw", folder / "imu_arrival.csv")
        self.table = AppendFile(folder / "imu.csv")
        self.table.append(imu_header(form))
        self._last_ns = -(1 << 62)
        self._decode = _Guard("imu", event)

    @property
    def files(self) -> tuple[AppendFile, ...]:
        """The files that grow."""
        return (*self.log.files, self.table)

    def drain(self) -> None:
        """Write what came in since the last call."""
        pieces = self.reader.take()
        self.log.append([(t, data) for t, data in pieces if data])
        with self.lock:
            self._decode.run(lambda: self._samples(pieces))

    def state(self, now_ns: int) -> ImuState:
        """The sensor as of now."""
        with self.lock:
            return self.watch.update(now_ns, self.clock.skew, self.clock.resets)

    def conditions(self, now_ns: int, started_ns: int) -> dict[str, str]:
        """What is wrong now."""
        with self.lock:
            self.watch.update(now_ns, self.clock.skew, self.clock.resets)
            return self.watch.conditions(now_ns, started_ns, self.reader.last_byte_ns)

    def _samples(self, pieces: list[tuple[int, bytes | None]]) -> None:
        samples: list[Sample] = []
        for t_ns, data in pieces:
            if data is None:
                self.decoder.restart()
            else:
                samples += self.decoder.feed(t_ns, data)
        stamps = stamp(samples, self.clock)
        self.table.append(imu_rows(stamps, samples, self.form))
        self.watch.take(stamps, [sample.values for sample in samples], self.decoder.bad)


def imu_header(form: ImuFormat) -> bytes:
    """First line of ``imu.csv``."""
    names = ["t_ns", *READINGS]
    if form.has_temperature:
        names.append("temp_c")
    if form.has_clock:
        names.append("device_ns")
    return (",".join(names) + "\n").encode()


def stamp(samples: list[Sample], clock: DeviceClock) -> list[int]:
    """Host times of samples [n], increasing."""
    if not samples:
        return []
    if samples[0].device_ns is not None:
        device = [sample.device_ns or 0 for sample in samples]
        return clock.stamps(device, [sample.arrival_ns for sample in samples])
    return [sample.arrival_ns for sample in samples]


def imu_rows(stamps: list[int], samples: list[Sample], form: ImuFormat) -> bytes:
    """Lines of ``imu.csv``."""
    rows = []
    for t_ns, sample in zip(stamps, samples, strict=True):
        cells = [str(t_ns), *map(_plain, sample.values)]
        if form.has_clock:
            cells.append(str(sample.device_ns))
        rows.append(",".join(cells))
    return ("\n".join(rows) + "\n").encode() if rows else b""


def _plain(value: float | int) -> str:
    return str(value) if isinstance(value, int) else repr(round(value, 12))


class _Guard:
    """Runs what may fail without stopping the recording; tells the first failure."""

    def __init__(self, label: str, event: Event) -> None:
        self._label = label
        self._event = event
        self._told = False

    def run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:
            if not self._told:
                self._told = True
                self._event(
                    "warning",
                    f"{self._label}: the live decoding failed ({type(error).__name__}: {error}); "
                    "the bytes are recorded all the same",
                )
