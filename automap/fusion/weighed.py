"""A path with the verdict on it, and sigmas as that wants them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from automap.fusion.aside import whole_trajectory
from automap.fusion.doubts import outcome
from automap.fusion.doubts.reason import Reason, Verdict, verdict_of
from automap.records import Trajectory


@dataclass(frozen=True)
class Weighed:
    """A path of ``rows`` rows with sigmas as the ``verdict`` wants them, made anew at each call of
    ``run``, stretch by stretch; ``horizontal_sd`` m the median of its sigmas. With ``alone`` it is
    that of the fixes without the IMU; ``unread_m`` were driven without readings, and are so too."""

    verdict: Verdict
    run: Callable[[], Iterator[Trajectory]]
    rows: int
    horizontal_sd: float
    alone: bool = False
    unread_m: float = 0.0

    @property
    def trajectory(self) -> Trajectory:
        """The whole path."""
        return whole_trajectory(self.run())


def weighed_path(
    run: Callable[[], Iterator[Trajectory]], reasons: Sequence[Reason], alone: bool
) -> Weighed:
    """The path that ``run`` makes, weighed by ``reasons``; ``alone`` as in :class:`Weighed`."""
    level = np.concatenate([np.hypot(*stretch.sd_pos_ned[:, :2].T) for stretch in run()])
    sd = float(np.median(level))
    unsure = outcome.unsure_path(sd, any(r.code == "accuracy_overstated" for r in reasons))
    return Weighed(verdict_of([*reasons, *unsure]), run, len(level), sd, alone)


def level_sd(stretches: Iterable[Trajectory]) -> float:
    """Median one-sigma error of a path, m an axis of the level."""
    return float(
        np.sqrt(np.median(np.concatenate([(p.sd_pos_ned[:, :2] ** 2).mean(1) for p in stretches])))
    )
