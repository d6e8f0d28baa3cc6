"""The host's clock, and a device's clock seen through jittery deliveries."""

from __future__ import annotations

import time
from collections import deque

_BLOCK_NS = 1_000_000_000
_BLOCKS = 40
_BASELINE_NS = 5_000_000_000
_MAX_SKEW = 0.05
_SUDDEN_NS = 20_000_000
_LONG_DELAY_NS = 2_000_000_000
_CONVINCED = 5
_LATE_NS = 250_000_000


class HostClock:
    """The host's monotonic clock in ns; for a replay at speed, ``factor`` times as fast."""

    def __init__(self, factor: float = 1.0) -> None:
        self.factor = factor
        self._start = time.monotonic_ns()

    def __call__(self) -> int:
        """Now."""
        return self.at(time.monotonic_ns())

    def at(self, monotonic_ns: int) -> int:
        """This clock when the system's monotonic clock showed ``monotonic_ns``."""
        if self.factor == 1.0:
            return monotonic_ns
        return self._start + round((monotonic_ns - self._start) * self.factor)


class DeviceClock:
    """Host times of a device's own stamps, freed from the jitter of their arrival.

    A sample arrives after it was taken, sometimes much later, never earlier: arrival minus
    device time has a sharp lower edge. The line under that edge (a side of the lower convex
    hull of the minima of the last 40 seconds) is the device's offset and skew; stamps follow
    it and so keep the device's own regularity. The shortest delivery remains in them.

    Source: Moon, Skelly and Towsley, "Estimation and removal of clock skew from network delay
    measurements", INFOCOM 1999 (the line under all delays, here over a sliding window).
    """

    def __init__(self) -> None:
        self.resets = 0
        self._forget()

    def _forget(self) -> None:
        # of each second the fastest delivery: device time, arrival less device time
        self._blocks: deque[tuple[int, int]] = deque(maxlen=_BLOCKS)
        self._block_begin = 0
        self._line: tuple[int, float, float] | None = None
        self._last_device: int | None = None
        self._last_stamp: int | None = None
        self._in_order: int | None = None
        self._odd: list[int] = []

    @property
    def skew(self) -> float:
        """Host seconds per device second, less one; 0 until five seconds have been seen."""
        return self._line[2] if self._line else 0.0

    def stamps(self, device_ns: list[int], arrival_ns: list[int]) -> list[int]:
        """Host times of samples [n] taken at ``device_ns`` that arrived at ``arrival_ns``.

        Called with the samples of a fraction of a second, in their order. Stamps increase, but
        for samples that the device itself sent twice or late.
        A device clock that starts anew, or a stamp that makes no sense, is met with the
        arrival time until five samples in a row agree on a new offset.
        """
        odd = self._note(device_ns, arrival_ns)
        self._fit()
        stamps = []
        for device, arrival, strange in zip(device_ns, arrival_ns, odd, strict=True):
            stamp = arrival
            if self._line is not None and not strange:
                at, offset, skew = self._line
                stamp = min(device + round(offset + skew * (device - at)), arrival)
            if self._last_stamp is not None and stamp <= self._last_stamp:
                if not strange and self._in_order is not None and device <= self._in_order:
                    # a line that came twice, or after a later one: readers put it in its place
                    stamps.append(stamp)
                    continue
                stamp = self._last_stamp + 1
            self._last_stamp, self._in_order = stamp, device
            stamps.append(stamp)
        return stamps

    def _note(self, device_ns: list[int], arrival_ns: list[int]) -> list[bool]:
        """Take samples into the blocks of minima; says which are out of line."""
        odd = []
        for device, arrival in zip(device_ns, arrival_ns, strict=True):
            delay = arrival - device
            if self._strange(device, delay):
                self._odd.append(delay)
                spread = max(self._odd[-_CONVINCED:]) - min(self._odd[-_CONVINCED:])
                if len(self._odd) < _CONVINCED or spread > 5 * _SUDDEN_NS:
                    odd.append(True)
                    continue
                last = self._last_stamp
                self._forget()
                self._last_stamp = last
                self.resets += 1
            self._odd = []
            self._last_device = max(device, self._last_device or device)
            if self._blocks and device - self._block_begin < _BLOCK_NS:
                at, least = self._blocks[-1]
                if delay - least <= self.skew * (device - at):
                    self._blocks[-1] = (device, delay)
            else:
                self._block_begin = device
                self._blocks.append((device, delay))
            odd.append(False)
        return odd

    def _strange(self, device: int, delay: int) -> bool:
        if self._last_device is None or not self._blocks:
            return False
        if device <= self._last_device - _LATE_NS:
            return True
        expected = self._blocks[-1][1]
        if self._line is not None:
            at, offset, skew = self._line
            expected = round(offset + skew * (device - at))
        # the window follows the clock, so a fall below the edge by this much is no skew
        passed = max(device - self._last_device, 0)
        return delay < expected - _SUDDEN_NS - _MAX_SKEW * min(passed, _BASELINE_NS) or (
            delay > expected + _LONG_DELAY_NS + passed
        )

    def _fit(self) -> None:
        blocks = list(self._blocks)
        if not blocks:
            return
        first, last = blocks[0], blocks[-1]
        if last[0] - first[0] < _BASELINE_NS:
            self._line = (last[0], float(min(delay for _, delay in blocks)), 0.0)
            return
        hull: list[tuple[int, int]] = []
        for point in blocks:
            while len(hull) > 1 and _turns_up(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        middle = (first[0] + last[0]) // 2
        right = next(i for i, point in enumerate(hull) if point[0] >= middle and i > 0)
        (t0, d0), (t1, d1) = hull[right - 1], hull[right]
        skew = min(max((d1 - d0) / (t1 - t0), -_MAX_SKEW), _MAX_SKEW)
        self._line = (t0, float(d0), skew)


def _turns_up(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> bool:
    """Whether b lies on or above the line from a to c, so is no corner of the lower hull."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
