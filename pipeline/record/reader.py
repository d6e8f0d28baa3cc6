"""The reading of a port, and coming back after an unplugging.

The bytes are read and stamped by a process of their own (:mod:`pipeline.record.pump`),
which this thread starts and listens to.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable

from pipeline.record import pump
from pipeline.record.clock import HostClock
from pipeline.record.ports import PortInfo, PortLostError, PortSpec, SerialPort, list_ports

HOLD_BYTES = 64 << 20
_WAIT_S = 0.2
_RETRY_S = 0.25
Event = Callable[[str, str], None]
"""Called with a level (note, warning) and a sentence."""


class PortReader(threading.Thread):
    """Reads one port for as long as it runs, whatever happens to the device.

    ``pieces`` receives (arrival in host ns, bytes); bytes None marks an interruption of the
    stream. ``interruptions`` counts them, ``refused_bytes`` those that found no room because
    nobody fetched them, ``overruns`` what the driver itself lost.
    """

    def __init__(self, label: str, spec: PortSpec, clock: HostClock, event: Event) -> None:
        super().__init__(name=f"read {label}", daemon=True)
        assert spec.baud is not None
        self.label = label
        self.device = spec.device
        self.baud = spec.baud
        self.pieces: deque[tuple[int, bytes | None]] = deque()
        self.interruptions = 0
        self.refused_bytes = 0
        self.overruns = 0
        self.total_bytes = 0
        self.last_byte_ns: int | None = None
        self._taken_bytes = 0
        self._clock = clock
        self._event = event
        self._port: SerialPort | None = None
        self._lock = threading.Lock()
        self._halt = threading.Event()
        self._ready = threading.Event()
        self._info: PortInfo | None = None
        self._driver_before = 0
        self._lost_at = 0

    @property
    def connected(self) -> bool:
        """Whether the port is open now."""
        return self._port is not None

    @property
    def native_usb(self) -> bool:
        """Whether this is a u-blox receiver's own USB port, which has no line rate."""
        return self._info is not None and self._info.u_blox

    def open(self) -> None:
        """Open the port for the first time; PortLostError with the reason."""
        self._port = SerialPort(self.device, self.baud)
        self._port.discard()
        self._driver_before = self._port.lost_in_driver()
        with contextlib.suppress(Exception):
            self._info = next((p for p in list_ports() if p.device == self.device), None)

    def write(self, data: bytes) -> None:
        """Send bytes to the device; nothing happens while it is away."""
        with self._lock, contextlib.suppress(PortLostError):
            if self._port is not None:
                self._port.write(data)

    def set_baud(self, baud: int) -> None:
        """Read on at another line rate."""
        self.baud = baud
        with self._lock, contextlib.suppress(PortLostError):
            if self._port is not None and self._port.baud != baud:
                self._port.set_baud(baud)
                self._put(self._clock(), None)

    def take(self) -> list[tuple[int, bytes | None]]:
        """What has come in since the last call, in order."""
        taken = []
        while self.pieces:
            piece = self.pieces.popleft()
            self._taken_bytes += len(piece[1] or b"")
            taken.append(piece)
        return taken

    def check_driver(self) -> int:
        """How much the driver lost since the last call."""
        with self._lock:
            port = self._port
            now = port.lost_in_driver() if port is not None else self._driver_before
        lost, self._driver_before = max(now - self._driver_before, 0), now
        self.overruns += lost
        return lost

    def stop(self) -> None:
        """Make the thread end soon."""
        self._halt.set()

    def run(self) -> None:
        """Read until told to stop."""
        while not self._halt.is_set():
            port = self._port
            if port is None:
                self._come_back()
                continue
            try:
                if port.descriptor is None:
                    self._read_here(port)
                else:
                    self._read_by_pump(port, port.descriptor)
            except PortLostError as lost:
                if self._port is port:
                    self._gone(str(lost))
        with self._lock:
            if self._port is not None:
                self._port.close()

    def _read_here(self, port: SerialPort) -> None:
        """Read in this thread, where a port cannot be handed to another process."""
        self._ready.set()
        while True:
            ending = self._halt.is_set()
            t_ns, data = port.read(0.0 if ending else _WAIT_S)
            if data:
                self._put(self._clock.at(t_ns), data)
            elif ending:
                return

    def _read_by_pump(self, port: SerialPort, fd: int) -> None:
        """Let a process read and stamp; take over what it sends."""
        command = [sys.executable, "-I", "-S", pump.__file__, str(fd)]
        command += [] if self._ready.is_set() else ["fresh"]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=[fd],
            # Ctrl-C on the terminal is for the recorder, which then ends the pump
            start_new_session=True,
        ) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            pipe = process.stdout.fileno()
            _widen(pipe)
            # one place for all readings: of a million bytes made anew for each, holes stay
            room = memoryview(bytearray(1 << 20))
            held = bytearray()
            told = False
            while True:
                if self._halt.is_set() and not told:
                    process.stdin.close()
                    told = True
                ready, _, _ = select.select([pipe], [], [], _WAIT_S)
                if not ready:
                    continue
                count = os.readv(pipe, [room])
                if not count:
                    break
                held += room[:count]
                self._unpack(held)
        if not told:
            raise PortLostError("the device was unplugged")

    def _unpack(self, held: bytearray) -> None:
        """Take whole frames off the front of what the pump sent."""
        at = 0
        while len(held) - at >= pump.FRAME.size:
            t_ns, size = pump.FRAME.unpack_from(held, at)
            end = at + pump.FRAME.size + size
            if end > len(held):
                break
            if size:
                self._put(self._clock.at(t_ns), bytes(held[end - size : end]))
            else:
                self._ready.set()
            at = end
        del held[:at]

    def wait_ready(self, timeout_s: float = 5.0) -> bool:
        """Wait until bytes are being read."""
        return self._ready.wait(timeout_s)

    def _put(self, t_ns: int, data: bytes | None) -> None:
        size = len(data or b"")
        if self.total_bytes - self._taken_bytes + size > HOLD_BYTES:
            self.refused_bytes += size
            return
        self.total_bytes += size
        if data:
            self.last_byte_ns = t_ns
        self.pieces.append((t_ns, data))

    def _gone(self, reason: str) -> None:
        with self._lock:
            if self._port is not None:
                self._port.close()
            self._port = None
        self.interruptions += 1
        self._lost_at = self._clock()
        self._put(self._lost_at, None)
        self._event("warning", f"{self.label}: {self.device} is lost ({reason}); waiting for it")

    def _come_back(self) -> None:
        device = self._find()
        if device is None:
            self._halt.wait(_RETRY_S)
            return
        try:
            port = SerialPort(device, self.baud)
        except PortLostError:
            self._halt.wait(_RETRY_S)
            return
        away_s = (self._clock() - self._lost_at) * 1e-9
        with self._lock:
            self.device, self._port = device, port
            self._driver_before = port.lost_in_driver()
        self._event("note", f"{self.label}: {device} is back after {away_s:.1f} s")

    def _find(self) -> str | None:
        """The port by its name, or the same USB device under another."""
        if "://" in self.device or os.name != "posix" or os.path.exists(self.device):
            return self.device
        if self._info is None or not self._info.hardware:
            return None
        with contextlib.suppress(Exception):
            for port in list_ports():
                if port.hardware == self._info.hardware:
                    return port.device
        return None


def _widen(pipe: int) -> None:
    """Room for many seconds of bytes, should this process be held up."""
    with contextlib.suppress(OSError, ImportError, AttributeError):
        import fcntl

        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, 1 << 20)
