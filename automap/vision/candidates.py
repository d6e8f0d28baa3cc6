"""Planned frames as they are decoded, without those whose picture shows nothing new.

A vehicle that stands sees the same again. One that drives does not: a picture that stays meanwhile
is of a camera that hung, or whose lens is covered, and its frames show no road.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, FrameTimes, Image, VideoFrame
from automap.vision import limits
from automap.vision.camera_path import CameraPath
from automap.vision.frame_choice import ChoiceRules, FramePlan
from automap.vision.parallel import Candidate

Grey = npt.NDArray[np.float32]

_THUMBNAIL = (128, 72)


@dataclass(frozen=True)
class Mark:
    """``row`` of the frame among all frames, ``number`` among those that are planned."""

    row: int
    number: int


@dataclass(frozen=True)
class Repeated:
    """Pictures from ``first_ns`` to ``last_ns`` that stay while ``metres`` are driven."""

    first_ns: int
    last_ns: int
    metres: float


@dataclass
class Repeats:
    """Frames that show the picture of an earlier one while the vehicle drives.

    ``driven`` [n] m travelled until each frame; ``told`` the stretches that are long enough for a
    sign to be passed unseen, as far as frames have been looked at.
    """

    driven: FloatArray
    told: list[Repeated] = field(default_factory=list)
    _seen: tuple[Grey, int, int] | None = None

    def __call__(self, picture: VideoFrame, now: Grey, row: int) -> bool:
        """Whether a frame, with its thumbnail, repeats an earlier one."""
        if self._seen is None or np.abs(now - self._seen[0]).max() > limits.REPEATED_GREYS:
            self._seen = now, row, picture.t_ns
            return False
        _, first, first_ns = self._seen
        metres = float(self.driven[row] - self.driven[first])
        if metres >= limits.UNSEEN_M:
            if self.told and self.told[-1].first_ns == first_ns:
                self.told.pop()
            self.told.append(Repeated(first_ns, picture.t_ns, metres))
        return metres >= limits.REPEATED_M


def driven_m(times: FrameTimes, path: CameraPath | None) -> FloatArray:
    """Metres [n] driven until each frame, as far as the path knows: at rest a path wanders."""
    if path is None or not len(times):
        return np.zeros(len(times))
    travelled, _, known = path.steps()
    seconds = np.diff(times.t_ns, prepend=times.t_ns[:1]) * 1e-9
    return np.cumsum(np.where(known & (travelled > limits.DRIVEN_SPEED * seconds), travelled, 0.0))


def candidates(
    pictures: Iterable[VideoFrame], times: FrameTimes, plan: FramePlan, repeats: Repeats
) -> Iterator[Candidate[Mark]]:
    """The planned frames as they are decoded, without those in which nothing has changed."""
    seen: Grey | None = None
    seen_ns = 0
    for picture in pictures:
        number = int(np.searchsorted(plan.frame, picture.frame))
        row = int(np.searchsorted(times.frame, picture.frame))
        now = _thumbnail(picture.image)
        if repeats(picture, now, row):
            continue
        if plan.still[number]:
            waited = (picture.t_ns - seen_ns) * 1e-9
            if seen is not None and waited < ChoiceRules().idle_s and _alike(seen, now):
                continue
            seen, seen_ns = now, picture.t_ns
        yield Candidate(picture, bool(plan.coarse[number]), Mark(row, number))


def _thumbnail(image: Image) -> Grey:
    small = cv2.resize(image, _THUMBNAIL, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), np.float32)


def _alike(one: Grey, other: Grey) -> bool:
    """Whether next to nothing differs; light that changes everywhere is no motion.

    At night little of the picture changes even in motion, so that little is enough.
    """
    change = other - one
    change -= np.median(change)
    return float(np.mean(np.abs(change) > limits.STILL_GREYS)) < limits.STILL_SHARE
