"""A fused drive as all that speaks for or against its path looks at it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.aside import Aside
from automap.fusion.delay_states import LATENCY_STATE
from automap.fusion.doubts.estimates import Estimates, beside_scale, final_estimates, of_axes
from automap.fusion.doubts.larger_errors import LargerErrors, larger_errors
from automap.fusion.gnss_only import uncorrected
from automap.fusion.measurements.position import age_sd_of
from automap.fusion.nodes import FixModel, model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.fusion.weighed import level_sd
from automap.records import ClockModel, Fixes, FloatArray, Trajectory
from automap.sync.limits import DELAY_SD_S
from automap.sync.velocity_findings import VelocityConsistency


@dataclass(frozen=True)
class Judged:
    """A ``result``, its path put aside as ``fused``, and what it was made of.

    ``fixes`` state errors as large as they are in worse stretches (``larger``), and ``stated`` are
    they as measurements; of what ``receiver`` tells of them is gone what such errors make;
    ``found`` is what was estimated at the end. ``delay`` and ``delay_is_clock`` as in
    ``fuse_imu_gnss``, ``lever_arm`` [3] m to the antenna as it was stated.
    """

    result: FusionResult
    fused: Aside
    fixes: Fixes
    clock: ClockModel
    options: FusionOptions
    delay: Prior
    delay_is_clock: bool
    receiver: VelocityConsistency
    lever_arm: FloatArray | None
    larger: LargerErrors
    stated: FixModel
    found: Estimates

    @property
    def age_s(self) -> float:
        """Of the fixes."""
        return self.found.get(LATENCY_STATE, (0.0, 0.0))[0]

    @property
    def arm(self) -> FloatArray:
        """To the antenna, [3] m, as it was estimated."""
        return of_axes(self.found, "gnss_lever_arm")

    @property
    def old_s(self) -> float:
        """Sigma, s, of what dates the path."""
        return math.hypot(age_sd_of(self.fixes, self.clock, self.options), self.result.delay.sd)

    @property
    def velocity_late_s(self) -> float:
        """By how much, s, velocities may be told late: as the motions that IMU and receiver share
        tell, no more than the fixes are of earlier instants than their stamps."""
        by_motions = self.delay_is_clock and self.clock.method != "arrival"
        if by_motions or LATENCY_STATE in self.found:
            return DELAY_SD_S
        return min(max(-self.result.delay.mean, 0.0) + self.delay.sd, DELAY_SD_S)

    def known(self, lean: float) -> Iterator[tuple[slice, Trajectory]]:
        """The path's stretches as sure as it is of a mounting that leans by ``lean`` rad, of a
        scale that nothing shows, and of fixes that nothing corrects."""
        for rows, stretch in self.fused.stretches():
            leaning_too = np.hypot(stretch.sd_rpy, [lean, 0.0, 0.0])
            unsure = beside_scale(replace(stretch, sd_rpy=leaning_too), self.found)
            yield rows, uncorrected(unsure, self.fixes, self.options)

    def sd_m(self, lean: float) -> float:
        """What that path is good to, m an axis of the level."""
        return level_sd(stretch for _, stretch in self.known(lean))


def judged(
    result: FusionResult,
    fused: Aside,
    fixes: Fixes,
    clock: ClockModel,
    options: FusionOptions,
    delay: Prior,
    delay_is_clock: bool,
    receiver: VelocityConsistency,
    lever_arm: FloatArray | None = None,
) -> Judged:
    """What a verdict is to be given on: ``fixes`` as they were fused, ``receiver`` what they say of
    each other as recorded, the rest as in :class:`Judged`."""
    larger = larger_errors(fixes, result, options)
    stated = model_fixes(larger.fixes, larger.fixes.gps_s, options)
    return Judged(
        *(result, fused, larger.fixes, clock, options, delay, delay_is_clock),
        *(larger.unheld_of(receiver), lever_arm, larger, stated, final_estimates(result)),
    )
