"""Samples of a serial inertial sensor out of its bytes, as they come in."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from dataclasses import dataclass

from pipeline.record.checksums import CHECKSUMS
from pipeline.record.imu_format import READINGS, ImuFormat

_LONGEST_LINE = 1024


@dataclass(frozen=True)
class Sample:
    """One reading: arrival of its first byte, the device's own time in ns or None, and
    gx .. az (and the temperature) in the format's units."""

    arrival_ns: int
    device_ns: int | None
    values: tuple[float | int, ...]


class ImuDecoder:
    """Takes pieces of a stream, gives the samples that became whole.

    ``samples``, ``bad`` (a wrong checksum, count of values or number) and ``other`` (lines of
    another kind, bytes between frames) are counts since the start.
    """

    def __init__(self, form: ImuFormat) -> None:
        self.form = form
        self.samples = 0
        self.bad = 0
        self.other = 0
        self._held = bytearray()
        self._passed = 0  # bytes of the stream before the held ones
        self._marks: deque[tuple[int, int]] = deque()
        self._count: int | None = None
        self._turns = 0
        self._fresh = True
        order = (*READINGS, "temp_c") if form.has_temperature else READINGS
        self._places = [form.columns.index(name) for name in order]
        scale = dict(form.scale)
        self._factors = [scale.get(name) for name in order]
        self._time_place = form.columns.index("time") if form.has_clock else None
        self._time_factor = form.ns_per_count * scale.get("time", 1.0)

    def restart(self) -> None:
        """Forget a piece of a line: the stream was interrupted."""
        self._passed += len(self._held)
        self._held.clear()
        self._fresh = True

    def feed(self, t_ns: int, data: bytes) -> list[Sample]:
        """The samples that end in ``data``, which arrived at ``t_ns``."""
        self._marks.append((self._passed + len(self._held), t_ns))
        self._held += data
        found = self._lines() if self.form.text else self._frames()
        while len(self._marks) > 1 and self._marks[1][0] <= self._passed:
            self._marks.popleft()
        self.samples += len(found)
        return found

    def _arrival(self, at: int) -> int:
        """When the held byte at a place arrived."""
        place = self._passed + at
        return next((t for begin, t in reversed(self._marks) if begin <= place), self._marks[0][1])

    def _drop(self, count: int) -> None:
        del self._held[:count]
        self._passed += count

    # ---- text

    def _lines(self) -> list[Sample]:
        found = []
        at = 0
        while (end := self._held.find(b"\n", at)) >= 0:
            sample = self._line(bytes(self._held[at:end]), self._arrival(at))
            if sample is not None:
                found.append(sample)
            at = end + 1
            self._fresh = False
        self._drop(at)
        if len(self._held) > _LONGEST_LINE:
            self.other += 1
            self._drop(len(self._held))
        return found

    def _line(self, raw: bytes, arrival_ns: int) -> Sample | None:
        text = raw.decode("latin-1").strip()
        form = self.form
        if not text:
            return None
        if form.prefix:
            # what stands before the prefix is a line whose end was lost
            begin = text.rfind(form.prefix)
            if begin < 0:
                self.other += 1
                return None
            text = text[begin:]
        if form.checksum == "nmea":
            body, star, check = text.rpartition("*")
            if not star or not _xor_agrees(body.lstrip("$!"), check):
                self._spoiled()
                return None
            text = body
        text = text[len(form.prefix) :].strip()
        if form.separator != " ":
            cells = text.strip(form.separator).split(form.separator)
        else:
            cells = text.split()
        if len(cells) == len(form.columns):
            with contextlib.suppress(ValueError):
                return self._sample([_number(cell) for cell in cells], arrival_ns)
        self._foreign(cells)
        return None

    def _foreign(self, cells: list[str]) -> None:
        """A header or a message in words is no damaged sample."""
        if cells[0][:1].isalpha() or cells[0][:1] in "#%":
            self.other += 1
        else:
            self._spoiled()

    def _spoiled(self) -> None:
        if not self._fresh:  # the first line may have begun before we listened
            self.bad += 1

    # ---- binary

    def _frames(self) -> list[Sample]:
        form, held = self.form, self._held
        assert form.layout is not None
        size, head = form.frame_bytes, len(form.sync)
        found = []
        at = 0
        while True:
            begin = held.find(form.sync, at)
            if begin < 0:
                keep = max(at, len(held) - head + 1)
                self.other += keep - at
                at = keep
                break
            self.other += begin - at
            at = begin
            if len(held) - at < size:
                break
            frame = bytes(held[at : at + size])
            if not self._checked(frame):
                self._spoiled()
                at += 1
                continue
            self._fresh = False
            values = list(form.layout.unpack_from(frame, head))
            try:
                found.append(self._sample(values, self._arrival(at)))
            except ValueError:
                self.bad += 1
            at += size
        self._drop(at)
        return found

    def _checked(self, frame: bytes) -> bool:
        form = self.form
        assert form.layout is not None
        if form.checksum is None:
            return True
        length, function = CHECKSUMS[form.checksum]
        end = len(form.sync) + form.layout.size
        order = "big" if form.layout.format.startswith(">") else "little"
        if form.checksum == "fletcher8":
            order = "little"  # two bytes in the order in which they are summed
        sent = int.from_bytes(frame[end : end + length], order)  # type: ignore[arg-type]
        return sent == function(frame[form.checksum_from : end])

    # ---- both

    def _sample(self, values: list[float | int], arrival_ns: int) -> Sample:
        readings = []
        for place, factor in zip(self._places, self._factors, strict=True):
            value = values[place]
            if not math.isfinite(value):
                raise ValueError("not finite")
            readings.append(value if factor is None else value * factor)
        device = None
        if self._time_place is not None:
            device = self._unwrapped(values[self._time_place])
        return Sample(arrival_ns, device, tuple(readings))

    def _unwrapped(self, count: float | int) -> int:
        """The device's time in ns, running on where its counter starts at 0 again."""
        wraps = self.form.wraps_at
        if wraps and self._count is not None and count < self._count - wraps // 2:
            self._turns += 1
        self._count = int(count)
        total = count + self._turns * wraps
        return int(total) if self._time_factor == 1 else round(total * self._time_factor)


def _number(cell: str) -> float | int:
    try:
        return int(cell)
    except ValueError:
        return float(cell)


def _xor_agrees(body: str, check: str) -> bool:
    value = 0
    for byte in body.encode("latin-1"):
        value ^= byte
    try:
        return int(check, 16) == value
    except ValueError:
        return False
