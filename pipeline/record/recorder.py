"""A recording in progress: the threads and files of one drive."""

from __future__ import annotations

import shutil
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.atomic import make_folder, write_json, write_text
from automap.io.manifest import Manifest
from pipeline.record.append_file import AppendFile
from pipeline.record.camera import Camera, CameraState
from pipeline.record.clock import HostClock
from pipeline.record.conditions import Conditions
from pipeline.record.ending import Ending, describe
from pipeline.record.gnss_watch import GnssState, GnssWatch
from pipeline.record.imu_format import ImuFormat
from pipeline.record.imu_watch import ImuState
from pipeline.record.manifest_text import manifest_text
from pipeline.record.ports import PortLostError, PortSpec, port_sentence
from pipeline.record.reader import PortReader
from pipeline.record.receiver_setup import ReceiverSetup
from pipeline.record.streams import GnssStream, ImuStream
from pipeline.record.ublox import Setup
from pipeline.record.video_source import Source

_WRITE_S = 0.1
_SYNC_S = 1.0
_LOOK_S = 0.5
_LOW_DISK_BYTES = 500 << 20
_LOW_DISK_S = 600.0
_TOLD = frozenset({"gnss-lost", "imu-lost"})
LOG = "recording.log"
SUMMARY = "recording.json"


@dataclass(frozen=True)
class Plan:
    """What is to be recorded. Ports carry their line rate; ``setup`` is for the receiver."""

    gnss: PortSpec | None = None
    imu: PortSpec | None = None
    imu_format: ImuFormat | None = None
    cameras: tuple[tuple[str, Source], ...] = ()
    rig: Manifest | None = None
    setup: Setup | None = None
    restore: bool = False
    name: str | None = None


@dataclass(frozen=True)
class Snapshot:
    """Everything the live view shows."""

    elapsed_s: float
    gnss: GnssState | None
    imu: ImuState | None
    gnss_port: str
    imu_port: str
    cameras: dict[str, CameraState]
    disk_free: int
    disk_left_s: float
    bytes_written: int
    bytes_waiting: int
    troubles: tuple[str, ...]
    events: tuple[str, ...]


class Recorder:
    """Records one drive from ``start`` to ``stop``."""

    def __init__(self, folder: Path, plan: Plan, clock: HostClock) -> None:
        self.folder = folder
        self.plan = plan
        self._clock = clock
        self._events: deque[str] = deque(maxlen=200)
        self._warnings: list[str] = []
        self._conditions = Conditions(self.event)
        self._gnss: GnssStream | None = None
        self._imu: ImuStream | None = None
        self._cameras = [Camera(*named, clock, self.event) for named in plan.cameras]
        self._log: AppendFile | None = None
        self.stopped = False
        self._halt = threading.Event()
        self._threads: list[threading.Thread] = []
        self._started_ns = 0
        self._begun = datetime.now(UTC)
        self._receiver_setup: ReceiverSetup | None = None
        self._disk: deque[tuple[int, int]] = deque(maxlen=120)
        self._event_lock = threading.Lock()

    # ---- begin and end

    def start(self) -> None:
        """Open ports and files, write the manifest, begin.

        Raises InputError for a port that cannot be opened, ConfigError for a folder that
        holds a drive already, StageError when it cannot be written.
        """
        if (self.folder / names.MANIFEST).exists():
            raise ConfigError(
                f"{self.folder} holds a drive already; choose another folder with -o."
            )
        readers = self._open_ports()
        for camera in self._cameras:
            camera.connect()
        make_folder(self.folder)
        self._log = AppendFile(self.folder / LOG)
        gnss, imu = readers.get("gnss"), readers.get("imu")
        setup = self.plan.setup
        if gnss is not None:
            watch = GnssWatch(setup.rate_hz if setup else None, bool(setup and setup.raw))
            self._gnss = GnssStream(self.folder, gnss, watch, self.event)
            self._receiver_setup = ReceiverSetup(
                self.folder, self._gnss, setup, self._clock, self.event, self._halt
            )
        if imu is not None:
            assert self.plan.imu_format is not None
            self._imu = ImuStream(self.folder, imu, self.plan.imu_format, self.event)
        write_text(self.folder / names.MANIFEST, self._manifest())
        self._started_ns = self._clock()
        self.event("note", "recording begins")
        for reader in readers.values():
            reader.start()
        for reader in readers.values():
            reader.wait_ready()
        for camera in self._cameras:
            camera.start(self.folder)
        for work in (self._write, self._sync, self._mind, self._tend):
            thread = threading.Thread(target=work, name=work.__name__[1:], daemon=True)
            thread.start()
            self._threads.append(thread)

    def _open_ports(self) -> dict[str, PortReader]:
        readers = {}
        for label, spec in (("gnss", self.plan.gnss), ("imu", self.plan.imu)):
            if spec is None:
                continue
            reader = PortReader(label, spec, self._clock, self.event)
            try:
                reader.open()
            except PortLostError as error:
                raise port_sentence(spec, error) from error
            readers[label] = reader
        if not readers and not self._cameras:
            raise InputError(
                "there is nothing to record; automap record --list-ports shows the ports, "
                "--gnss, --imu and --camera name them."
            )
        return readers

    def _manifest(self) -> str:
        return manifest_text(
            self.plan.name or self.folder.resolve().name,
            "gnss.ubx" if self._gnss else None,
            self.plan.imu_format if self._imu else None,
            {camera.name: camera.manifest for camera in self._cameras},
            self.plan.rig,
        )

    def stop(self) -> Ending:
        """End the recording: everything that came in until now is written and synced."""
        self.stopped = True
        if self.plan.restore and self._receiver_setup is not None:
            self._receiver_setup.restore()
        for stream in self._streams():
            stream.reader.stop()
        for stream in self._streams():
            stream.reader.join(timeout=2.0)
        for camera in self._cameras:
            camera.stop()
        self._halt.set()
        for thread in self._threads:
            thread.join(timeout=10.0)
        for stream in self._streams():
            stream.drain()
        ending = self._ending()
        self.event("note", f"recording ends after {ending.seconds:.1f} s")
        for file in self._files():
            if not file.close() and file.trouble:
                self._warnings.append(file.trouble)
        write_json(self.folder / SUMMARY, ending.summary)
        return ending

    # ---- threads

    def _write(self) -> None:
        while not self._halt.wait(_WRITE_S):
            for stream in self._streams():
                stream.drain()

    def _sync(self) -> None:
        # in a thread of its own: a slow card takes seconds, in which writing goes on
        while not self._halt.wait(_SYNC_S):
            for file in self._files():
                file.sync()

    def _mind(self) -> None:
        """Watch for trouble."""
        while not self._halt.wait(_LOOK_S):
            self._guarded(lambda: self._conditions.update(self._look(), _TOLD))

    def _tend(self) -> None:
        """Set the receiver up, find one again that was reset: in a thread of its own, since it
        takes many seconds to try all line rates."""
        if self._receiver_setup is None:
            return
        self._guarded(self._receiver_setup.configure)
        while not self._halt.wait(_LOOK_S):
            self._guarded(self._receiver_setup.recover)

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do what may fail without harm to the recording; tell a failure once."""
        try:
            work()
        except Exception as error:
            text = f"the watch over the recording failed ({error}); recording goes on"
            if text not in self._warnings:
                self.event("warning", text)

    def _look(self) -> dict[str, str]:
        now = self._clock()
        found: dict[str, str] = {}
        if self._gnss is not None:
            reader = self._gnss.reader
            if reader.connected:
                baud = None if reader.native_usb or "/pts/" in reader.device else reader.baud
                found |= self._gnss.conditions(now, self._started_ns, baud)
        if self._imu is not None and self._imu.reader.connected:
            found |= self._imu.conditions(now, self._started_ns)
        if {"gnss-noise", "imu-noise"} <= found.keys():
            found["exchanged"] = (
                "neither the receiver's port nor the sensor's sends what it should; are --gnss and "
                "--imu exchanged?"
            )
        for stream in self._streams():
            label = stream.reader.label
            if not stream.reader.connected:
                found[f"{label}-lost"] = f"{label}: {stream.reader.device} is away"
            if stream.reader.check_driver():
                self.event("warning", f"{label}: the driver lost bytes (overrun)")
        for camera in self._cameras:
            found |= camera.conditions(now, self._started_ns)
        return found | self._disk_troubles(now)

    def _disk_troubles(self, now_ns: int) -> dict[str, str]:
        found: dict[str, str] = {}
        files = self._files()
        trouble = next((file.trouble for file in files if file.trouble), None)
        refused = sum(file.refused_bytes for file in files)
        if refused:
            found["disk-lost"] = "memory is used up too: bytes are being lost; free the disk now"
        if trouble:
            found["disk-full"] = f"{trouble}; what comes in is kept in memory meanwhile"
            return found
        free, left_s = self._room(now_ns)
        if free < _LOW_DISK_BYTES or left_s < _LOW_DISK_S:
            found["disk-low"] = f"the disk has {free / 1e6:.0f} MB left{_span(left_s)}"
        return found

    def _room(self, now_ns: int) -> tuple[int, float]:
        """Free bytes of the disk, and for how many seconds they last."""
        try:
            free = shutil.disk_usage(self.folder).free
        except OSError:
            return 0, 0.0
        written = sum(file.size for file in self._files())
        self._disk.append((now_ns, written))
        seen = list(self._disk)
        (t0, w0), (t1, w1) = seen[0], seen[-1]
        pace = (w1 - w0) / ((t1 - t0) * 1e-9) if t1 - t0 > 2e9 else 0.0
        return free, free / pace if pace > 0 else float("inf")

    # ---- what is known

    def event(self, level: str, text: str) -> None:
        """Keep a sentence for the view and the log; warnings also for the summary."""
        now = self._clock()
        line = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {now} {level}: {text}"
        with self._event_lock:
            self._events.append(f"{(now - self._started_ns) * 1e-9:8.1f} s  {level}: {text}"
                                if self._started_ns else f"{level}: {text}")  # fmt: skip
            if level == "warning" and len(self._warnings) < 1000:
                self._warnings.append(text)
            if self._log is not None:
                self._log.append(line.encode() + b"\n")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings since the start, in order."""
        return tuple(self._warnings)

    def _streams(self) -> list[GnssStream | ImuStream]:
        return [stream for stream in (self._gnss, self._imu) if stream is not None]

    def _files(self) -> list[AppendFile]:
        files = [file for stream in self._streams() for file in stream.files]
        files += [file for camera in self._cameras for file in camera.files]
        return files + ([self._log] if self._log is not None else [])

    def snapshot(self) -> Snapshot:
        """The recording as of now."""
        now = self._clock()
        free, left_s = self._room(now)
        files = self._files()
        with self._event_lock:
            events = tuple(self._events)
        return Snapshot(
            elapsed_s=(now - self._started_ns) * 1e-9,
            gnss=self._gnss.state(now) if self._gnss else None,
            imu=self._imu.state(now) if self._imu else None,
            gnss_port=f"{self._gnss.reader.device}@{self._gnss.reader.baud}" if self._gnss else "",
            imu_port=f"{self._imu.reader.device}@{self._imu.reader.baud}" if self._imu else "",
            cameras={camera.name: camera.state(now) for camera in self._cameras},
            disk_free=free,
            disk_left_s=left_s,
            bytes_written=sum(file.written for file in files),
            bytes_waiting=sum(file.waiting for file in files),
            troubles=tuple(self._conditions.active.values()),
            events=events,
        )

    def _ending(self) -> Ending:
        lost = sum(file.refused_bytes + file.waiting for file in self._files())
        lost += sum(stream.reader.refused_bytes for stream in self._streams())
        return describe(
            self.folder,
            self._begun,
            (self._clock() - self._started_ns) * 1e-9,
            lost,
            self.warnings,
            self._gnss,
            self._imu,
            self._cameras,
            self._receiver_setup.outcome if self._receiver_setup else None,
        )


def _span(seconds: float) -> str:
    """How long the room lasts, in brackets; "" as long as nothing tells it."""
    if seconds == float("inf"):
        return ""
    return f" ({seconds / 3600:.1f} h)" if seconds >= 5400 else f" ({seconds / 60:.0f} min)"
