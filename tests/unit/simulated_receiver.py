"""A u-blox receiver on a pseudo-terminal: it sends fixes and answers configuration messages."""

from __future__ import annotations

import os
import struct
import termios
import threading
import time
from pathlib import Path

from pipeline.record import ublox_keys as keys
from pipeline.record.messages import Message, MessageStream, ubx_frame
from pipeline.record.replay import Terminal

_SPEEDS = {
    getattr(termios, name): int(name[1:])
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdigit()
}
PVT_KEY_UART1 = 0x20910007
RAWX_KEY_UART1 = 0x209102A5
SFRBX_KEY_UART1 = 0x20910232


def nav_pvt(tow_ms: int, fix: int = 3, satellites: int = 14) -> bytes:
    """A NAV-PVT message of 2026-03-14 09:20 and the milliseconds of the week."""
    second, milli = divmod(tow_ms % 60_000, 1000)
    payload = bytearray(92)
    struct.pack_into("<IHBBBBBB", payload, 0, tow_ms, 2026, 3, 14, 9, 20, second, 7)
    struct.pack_into("<Ii", payload, 12, 25, milli * 1_000_000)
    payload[20], payload[21], payload[23] = fix, 1 if fix >= 2 else 0, satellites
    struct.pack_into("<iiii", payload, 24, 1_491_300_000, -352_800_000, 580_000, 560_000)
    struct.pack_into("<II", payload, 40, 1500, 2500)
    return ubx_frame(keys.NAV_PVT, bytes(payload))


class SimulatedReceiver(threading.Thread):
    """``generation`` 5, 6, 8 or 9. ``refuses`` holds keys or messages that it answers with NAK,
    ``deaf`` means that it never answers, ``forgets`` that it acknowledges without obeying.

    Its line rate is compared with that of the other end: at the wrong one it sends, and hears,
    nothing that makes sense.
    """

    def __init__(
        self,
        link: Path,
        generation: int = 9,
        baud: int = 38400,
        refuses: set[int] | None = None,
        deaf: bool = False,
        forgets: bool = False,
        chatter: bool = False,
    ) -> None:
        super().__init__(daemon=True)
        self.terminal = Terminal(link)
        self.generation = generation
        self.refuses = refuses or set()
        self.deaf = deaf
        self.forgets = forgets
        self.chatter = chatter  # NMEA from the start, as receivers do
        self.first_baud = baud
        self.sent = bytearray()
        self.commands: list[int] = []
        self._halt = threading.Event()
        self._stream = MessageStream()
        self._tow_ms = 0
        self.reset()

    def reset(self) -> None:
        """Power off and on: settings and line rate as from the factory."""
        self.baud = self.first_baud
        self.period_ms = 1000
        self.keys = {
            keys.KEY_RATE_MEAS: 1000, keys.KEY_RATE_NAV: 1, 0x40520001: self.baud,
            0x10740001: 1, 0x10760001: 1, PVT_KEY_UART1: 0, 0x20910008: 0,
            RAWX_KEY_UART1: 0, 0x209102A6: 0, SFRBX_KEY_UART1: 0, 0x20910233: 0,
        }  # fmt: skip
        self.rates: dict[int, int] = {}

    @property
    def on(self) -> set[int]:
        """Messages that are switched on."""
        if self.generation < 9:
            return {message for message, rate in self.rates.items() if rate}
        wired = {PVT_KEY_UART1: keys.NAV_PVT, RAWX_KEY_UART1: keys.RXM_RAWX}
        return {message for key, message in wired.items() if self.keys[key]}

    def stop(self) -> None:
        """Unplug it."""
        self._halt.set()
        self.join(timeout=2.0)
        self.terminal.close()

    def run(self) -> None:
        next_s = time.monotonic()
        while not self._halt.wait(0.01):
            heard = self.terminal.read()
            if heard and self._same_rate():
                for message in self._stream.feed(0, heard):
                    self._answer(message)
            if time.monotonic() >= next_s:
                next_s += self.period_ms * 1e-3
                self._epoch()

    def _same_rate(self) -> bool:
        speed = termios.tcgetattr(self.terminal._master)[5]
        return _SPEEDS.get(speed) == self.baud

    def _send(self, data: bytes) -> None:
        if not self.terminal.opened:
            return
        data = data if self._same_rate() else bytes(byte ^ 0x5A for byte in data)
        self.terminal.write(data, patience_s=0.2)
        self.sent += data

    def _epoch(self) -> None:
        self._tow_ms += self.period_ms
        if keys.NAV_PVT in self.on:
            self._send(nav_pvt(self._tow_ms))
        if keys.NAV_SOL in self.on:
            payload = bytearray(52)
            struct.pack_into("<I", payload, 0, self._tow_ms)
            payload[10], payload[11], payload[47] = 3, 1, 9
            self._send(ubx_frame(keys.NAV_SOL, bytes(payload)))
        for raw in (keys.RXM_RAWX, keys.RXM_RAW):
            if raw in self.on:
                self._send(ubx_frame(raw, bytes(16 + 32 * 8)))
        if self.chatter:
            self._send(b"$GNGLL,,,,,092000.00,V,N*5F\r\n" * 4)

    def _answer(self, message: Message) -> None:
        self.commands.append(message.key)
        if self.deaf:
            return
        key, payload = message.key, message.payload
        if key == keys.MON_VER:
            self._send(ubx_frame(key, self._version()))
        elif key == keys.CFG_VALGET and self.generation >= 9:
            self._valget(payload)
        elif key == keys.CFG_VALSET and self.generation >= 9:
            self._valset(payload)
        elif key in (keys.CFG_RATE, keys.CFG_MSG, keys.CFG_PRT) and self.generation < 9:
            self._old(key, payload)
        else:
            self._acknowledge(key, good=False)

    def _acknowledge(self, key: int, good: bool) -> None:
        self._send(ubx_frame(keys.ACK if good else keys.NAK, bytes((key >> 8, key & 255))))

    def _version(self) -> bytes:
        told = {
            5: ("5.00", "00040005", []),
            6: ("7.03 (45969)", "00040007", []),
            8: ("EXT CORE 3.01 (111141)", "00080000", ["PROTVER 18.00", "MOD=NEO-M8T-0"]),
            9: ("EXT CORE 1.00 (b2b1f5)", "00190000", ["PROTVER=27.31", "MOD=ZED-F9P"]),
        }
        software, hardware, more = told[self.generation]
        return (
            software.encode().ljust(30, b"\0")
            + hardware.encode().ljust(10, b"\0")
            + b"".join(text.encode().ljust(30, b"\0") for text in more)
        )

    def _valget(self, payload: bytes) -> None:
        asked = struct.unpack(f"<{(len(payload) - 4) // 4}I", payload[4:])
        if any(key not in self.keys for key in asked):
            self._acknowledge(keys.CFG_VALGET, good=False)
            return
        body = b"".join(
            struct.pack("<I", key) + struct.pack(keys.width(key), self.keys[key]) for key in asked
        )
        self._send(ubx_frame(keys.CFG_VALGET, b"\x01\0\0\0" + body))
        self._acknowledge(keys.CFG_VALGET, good=True)

    def _valset(self, payload: bytes) -> None:
        values = dict(keys.key_values(payload[4:]))
        assert payload[1] == 1, "only the working memory may be written"
        if any(key not in self.keys or key in self.refuses for key in values):
            self._acknowledge(keys.CFG_VALSET, good=False)
            return
        if not self.forgets:
            self.keys |= values
        self.period_ms = self.keys[keys.KEY_RATE_MEAS]
        self.baud = self.keys[0x40520001]
        self._acknowledge(keys.CFG_VALSET, good=True)

    def _old(self, key: int, payload: bytes) -> None:
        message = payload[0] << 8 | payload[1] if key == keys.CFG_MSG else 0
        if (
            key in self.refuses
            or message in self.refuses
            or (message == keys.NAV_PVT and self.generation < 7)
        ):
            self._acknowledge(key, good=False)
            return
        if key == keys.CFG_RATE and not payload:
            self._send(ubx_frame(key, struct.pack("<HHH", self.period_ms, 1, 1)))
        elif key == keys.CFG_RATE:
            if not self.forgets:
                self.period_ms = struct.unpack("<H", payload[:2])[0]
        elif key == keys.CFG_MSG and len(payload) == 2:
            rates = bytes((0, self.rates.get(message, 0), 0, 0, 0, 0))
            self._send(ubx_frame(key, payload + rates))
        elif key == keys.CFG_MSG:
            if not self.forgets:
                self.rates[message] = payload[2] if len(payload) == 3 else payload[3]
        elif not payload:
            port = struct.pack("<BBHIIHHHH", 1, 0, 0, 0x8D0, self.baud, 7, 3, 0, 0)
            self._send(ubx_frame(key, port))
        else:
            self.baud = struct.unpack_from("<I", payload, 8)[0]
        self._acknowledge(key, good=True)


def open_descriptors() -> int:
    """How many files this process has open."""
    return len(os.listdir("/proc/self/fd"))
