"""Rows along drives, and the stretches of some seconds that these are cut into."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from automap.gap.limits import BLOCKS_S
from automap.records import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Frame:
    """Times [s] in s, drives and channels [s] of rows."""

    t: FloatArray
    drive: IntArray
    channel: IntArray

    @cached_property
    def starts(self) -> Mapping[float, IntArray]:
        """First rows of the stretches of each of the lengths ``BLOCKS_S``."""
        return {length: stretches(self.t, self.drive, length) for length in BLOCKS_S}

    def some(self, at: BoolArray) -> Frame:
        """Some of the rows [s]."""
        return Frame(self.t[at], self.drive[at], self.channel[at])


def stretches(t: FloatArray, drive: IntArray, length_s: float) -> IntArray:
    """First rows of stretches of some seconds along each drive."""
    if len(t) == 0:
        return np.zeros(0, np.int64)
    number = ((t - t[0]) / length_s).astype(np.int64) + drive * (1 << 32)
    return np.flatnonzero(np.diff(number, prepend=-(1 << 40)))
