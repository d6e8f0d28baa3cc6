"""UBX messages and NMEA sentences from a stream that is still coming in.

The logs themselves are read by :mod:`automap.io.byte_scan`; here a message has to be known
the moment its last byte is there. Framing: u-blox F9 HPG 1.32 interface description, 3.2;
NMEA 0183 v4.11, 5.3.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

MAX_PAYLOAD = 8192
MAX_SENTENCE = 1024


@dataclass(frozen=True)
class Message:
    """One whole message with a correct checksum.

    ``key`` is class * 256 + id of UBX, 0 for NMEA; ``payload`` the UBX payload, or the
    sentence without dollar and checksum. ``t_ns``: arrival of its first byte.
    """

    t_ns: int
    key: int
    payload: bytes

    @property
    def address(self) -> str:
        """First field of an NMEA sentence, empty for UBX."""
        return "" if self.key else self.payload.split(b",", 1)[0].decode("ascii", "replace")


def fletcher(body: bytes) -> bytes:
    """The two check bytes over class, id, length and payload (RFC 1145, modulo 256)."""
    values = np.frombuffer(body, np.uint8).astype(np.int64)
    second = int(values @ np.arange(len(values), 0, -1)) & 255
    return bytes((int(values.sum()) & 255, second))


def ubx_frame(key: int, payload: bytes = b"") -> bytes:
    """A whole UBX message; ``key`` is class * 256 + id."""
    body = struct.pack("<BBH", key >> 8, key & 255, len(payload)) + payload
    return b"\xb5\x62" + body + fletcher(body)


class MessageStream:
    """Takes pieces of a stream, gives the messages that became whole.

    ``messages`` and ``stray_bytes`` (belonging to no message) are counts since the start.
    """

    def __init__(self) -> None:
        self.messages = 0
        self.stray_bytes = 0
        self.bad = 0
        self._held = bytearray()
        self._marks: list[tuple[int, int]] = []  # place in the held bytes, arrival of that byte

    def restart(self) -> None:
        """Forget a message half received: the stream was interrupted."""
        self.stray_bytes += len(self._held)
        self._held.clear()
        self._marks.clear()

    def feed(self, t_ns: int, data: bytes) -> list[Message]:
        """The messages that end in ``data``, which arrived at ``t_ns``."""
        self._marks.append((len(self._held), t_ns))
        self._held += data
        found: list[Message] = []
        at = 0
        held = self._held
        while at < len(held):
            first = held[at]
            if first == 0xB5:
                size = self._ubx(at)
            elif first == 0x24:
                size = self._nmea(at)
            else:
                size = -1
            if size == 0:
                break
            if size < 0:
                following = [
                    i for i in (held.find(b"\xb5", at + 1), held.find(b"$", at + 1)) if i > 0
                ]
                step = (min(following) if following else len(held)) - at
                self.stray_bytes += _solid(held[at : at + step])
                at += step
                continue
            found.append(self._message(at, size))
            at += size
        del held[:at]
        self._marks = _moved(self._marks, at)
        self.messages += len(found)
        return found

    def _ubx(self, at: int) -> int:
        """Length of the UBX message at a place; 0 when it is not all there, -1 when it is none."""
        held = self._held
        if len(held) - at < 2:
            return 0
        if held[at + 1] != 0x62:
            return -1
        if len(held) - at < 6:
            return 0
        payload = held[at + 4] | held[at + 5] << 8
        if payload > MAX_PAYLOAD:
            return -1
        if len(held) - at < payload + 8:
            return 0
        end = at + 6 + payload
        if fletcher(bytes(held[at + 2 : end])) != held[end : end + 2]:
            self.bad += 1
            return -1
        return payload + 8

    def _nmea(self, at: int) -> int:
        held = self._held
        end = held.find(b"\n", at, at + MAX_SENTENCE)
        if end < 0:
            return 0 if len(held) - at < MAX_SENTENCE else -1
        line = bytes(held[at + 1 : end]).rstrip(b"\r")
        body, star, check = line.rpartition(b"*")
        if b"$" in line or not star or len(check) != 2:
            return -1
        value = 0
        for byte in body:
            value ^= byte
        try:
            good = int(check, 16) == value
        except ValueError:
            good = False
        if not good:
            self.bad += 1
            return -1
        return end + 1 - at

    def _message(self, at: int, size: int) -> Message:
        held = self._held
        t_ns = next((t for place, t in reversed(self._marks) if place <= at), self._marks[0][1])
        if held[at] == 0xB5:
            payload = bytes(held[at + 6 : at + size - 2])
            return Message(t_ns, held[at + 2] << 8 | held[at + 3], payload)
        line = bytes(held[at + 1 : at + size]).rstrip(b"\r\n")
        return Message(t_ns, 0, line[: line.rfind(b"*")])


def _solid(data: bytes | bytearray) -> int:
    """Bytes that are no line ends."""
    return len(data) - data.count(b"\r") - data.count(b"\n")


def _moved(marks: list[tuple[int, int]], by: int) -> list[tuple[int, int]]:
    """Marks after the first ``by`` bytes have gone; the last before them stands for the rest."""
    left = [(place - by, t) for place, t in marks if place > by]
    before = [t for place, t in marks if place <= by]
    return ([(0, before[-1])] if before else []) + left
