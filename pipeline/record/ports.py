"""Serial ports: which there are, opening, reading without losing a byte, coming back."""

from __future__ import annotations

import contextlib
import os
import select
import struct
import sys
import time
from dataclasses import dataclass
from typing import Any

from automap.errors import ConfigError, InputError

BAUDS = (9600, 38400, 115200, 460800, 230400, 57600, 921600, 19200, 4800)
"""Rates tried when none is given, the usual ones of receivers first."""

_TIOCGICOUNT = 0x545D
_READ_BYTES = 65536


class PortLostError(Exception):
    """A port that was open has gone, or cannot be opened now."""


@dataclass(frozen=True)
class PortInfo:
    """A serial port of this machine; ``hardware`` is VID:PID and serial number of a USB device."""

    device: str
    description: str
    hardware: str = ""

    @property
    def u_blox(self) -> bool:
        """Whether it is a receiver's own USB port (vendor 1546 is u-blox)."""
        return self.hardware.upper().startswith("1546:")


@dataclass(frozen=True)
class PortSpec:
    """A port and the rate to open it with; ``baud`` None is to be found."""

    device: str
    baud: int | None = None

    def __str__(self) -> str:
        return self.device if self.baud is None else f"{self.device}@{self.baud}"


def parse_port(text: str) -> PortSpec:
    """``/dev/ttyUSB0``, ``COM3@115200`` or a pyserial URL; ConfigError for a wrong rate."""
    device, mark, rate = text.rpartition("@")
    if not mark:
        return PortSpec(text)
    if not device or not rate.isdigit() or not 300 <= int(rate) <= 12_000_000:
        raise ConfigError(
            f"{text!r} names no port; write PORT or PORT@BAUD, such as /dev/ttyUSB0@115200."
        )
    return PortSpec(device, int(rate))


def list_ports() -> list[PortInfo]:
    """The serial ports that have a device behind them, USB ones first."""
    from serial.tools import list_ports as known

    found = []
    for port in known.comports():
        if port.vid is None and port.hwid in (None, "", "n/a"):
            continue  # a UART that the board does not have
        hardware = ""
        if port.vid is not None:
            hardware = f"{port.vid:04X}:{port.pid:04X} {port.serial_number or ''}".strip()
        found.append(PortInfo(port.device, port.description or "", hardware))
    return sorted(found, key=lambda port: (not port.hardware, port.device))


class SerialPort:
    """An open port. Reading and writing raise PortLostError when it has gone."""

    def __init__(self, device: str, baud: int) -> None:
        """Open it raw, for this process alone, as low in latency as its driver can.

        Raises PortLostError with the reason.
        """
        import serial

        self.device = device
        options: dict[str, Any] = {"baudrate": baud, "timeout": 0.0, "write_timeout": 1.0}
        try:
            if "://" in device:
                self._serial: Any = serial.serial_for_url(device, **options)
            else:
                self._serial = serial.Serial(device, exclusive=True, **options)
        except (OSError, ValueError) as error:
            raise PortLostError(_reason(error)) from error
        self._fd = _descriptor(self._serial)
        with contextlib.suppress(Exception):
            # USB converters otherwise gather bytes for up to 16 ms; not every driver has it
            self._serial.set_low_latency_mode(True)

    @property
    def descriptor(self) -> int | None:
        """What a process of ours may wait on and read, None where the system has no such thing."""
        return self._fd

    @property
    def baud(self) -> int:
        """The rate in use."""
        return int(self._serial.baudrate)

    def set_baud(self, baud: int) -> None:
        """Change the rate, once what was written has left; bytes in transit may be lost."""
        try:
            with contextlib.suppress(Exception):
                self._serial.flush()
            self._serial.baudrate = baud
        except (OSError, ValueError) as error:
            raise PortLostError(_reason(error)) from error

    def discard(self) -> None:
        """Forget what arrived before; it is older than any stamp would say."""
        with contextlib.suppress(Exception):
            self._serial.reset_input_buffer()

    def read(self, timeout_s: float) -> tuple[int, bytes]:
        """Monotonic time (ns) of bytes that are there, and the bytes; none after ``timeout_s``."""
        try:
            if self._fd is None:
                return self._read_blocking(timeout_s)
            ready, _, _ = select.select([self._fd], [], [], timeout_s)
            t_ns = time.monotonic_ns()
            if not ready:
                return t_ns, b""
            data = os.read(self._fd, _READ_BYTES)
        except BlockingIOError:
            return time.monotonic_ns(), b""
        except (OSError, ValueError, TypeError) as error:
            raise PortLostError(_reason(error)) from error
        if not data:
            raise PortLostError("the device was unplugged")
        return t_ns, data

    def _read_blocking(self, timeout_s: float) -> tuple[int, bytes]:
        self._serial.timeout = timeout_s
        first = self._serial.read(1)
        t_ns = time.monotonic_ns()
        waiting = int(self._serial.in_waiting) if first else 0
        return t_ns, bytes(first) + (bytes(self._serial.read(waiting)) if waiting else b"")

    def write(self, data: bytes) -> None:
        """Send bytes to the device."""
        try:
            self._serial.write(data)
        except (OSError, ValueError) as error:
            raise PortLostError(_reason(error)) from error

    def lost_in_driver(self) -> int:
        """Bytes or moments that the driver counts as overrun since it was loaded; 0 unknown."""
        if self._fd is None or not sys.platform.startswith("linux"):
            return 0
        import fcntl

        try:
            raw = fcntl.ioctl(self._fd, _TIOCGICOUNT, bytes(80))
        except OSError:
            return 0
        # struct serial_icounter_struct: ... overrun 7th, buf_overrun 11th of its integers
        counts = struct.unpack("20i", raw)
        return int(counts[7]) + int(counts[10])

    def close(self) -> None:
        """Close it; a port that has gone is closed too."""
        with contextlib.suppress(Exception):
            self._serial.close()


def _descriptor(port: Any) -> int | None:
    """The file descriptor to wait on, None where the system has none (Windows, some URLs)."""
    if os.name != "posix":
        return None
    try:
        return int(port.fileno())
    except Exception:
        return None


def _reason(error: BaseException) -> str:
    text = " ".join(str(error).split())
    number = getattr(error, "errno", None)
    if "exclusively lock" in text:
        return "another program has it open"
    if number == 13 or "Permission denied" in text:
        return "no permission; add your user to the group of the device (often dialout)"
    if number == 2 or "No such file" in text:
        return "there is no such port"
    if number in (5, 6, 19) or "Input/output error" in text:
        return "the device was unplugged"
    return text or type(error).__name__


def port_sentence(spec: PortSpec, error: PortLostError) -> InputError:
    """The failure of a port that the user named."""
    return InputError(
        f"{spec.device} cannot be opened: {error}; automap record --list-ports shows what is there."
    )
