"""What is to be expected of fixes in stretches in which they err by more than elsewhere: the path
takes them for as bad as they are there, so that their jumps and ways aside are no news."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.doubts.position_jump import Jump
from automap.fusion.limits import DOUBT_PROBABILITY
from automap.fusion.measurements.position import (
    lasting_share,
    position_errors,
    quick_factor,
)
from automap.fusion.nodes import as_shown, model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult
from automap.fusion.worse_stretches import WINDOWS
from automap.gates import gate
from automap.records import Fixes, FloatArray
from automap.sync.velocity_findings import VelocityConsistency


@dataclass(frozen=True)
class LargerErrors:
    """``fixes`` that state errors as large as they are in worse stretches, and of those there, at
    ``t`` [m] GPS s, the sigmas NED ``sd`` [m, 3] m that the drive shows; edges of stretches are
    good to ``reach_s`` s."""

    fixes: Fixes
    t: FloatArray
    sd: FloatArray
    reach_s: float = 0.0

    def hold(self, by: FloatArray, begin: float, end: float) -> bool:
        """Whether from ``begin`` to ``end`` GPS s, or at an edge of a stretch there, two errors
        differ by as much as ``by`` [3] m NED."""
        near = (self.t > begin - self.reach_s) & (self.t < end + self.reach_s)
        largest = self.sd[near].max(axis=0, initial=0.0)
        return all(
            float(by[axes] @ by[axes])
            <= 2.0 * gate(DOUBT_PROBABILITY, len(by[axes])) * largest[axes].max() ** 2
            for axes in (slice(0, 2), slice(2, 3))
        )

    def unheld(self, jumps: Sequence[Jump]) -> list[Jump]:
        """The ``jumps`` but those that errors there make."""
        return [jump for jump in jumps if not self.hold(jump.by, jump.gps_s, jump.gps_s)]

    def unheld_of(self, found: VelocityConsistency) -> VelocityConsistency:
        """What was ``found`` without stretches in which positions part from velocities by as much
        as errors there make; what lies between such is aside only where others are left."""
        parted = tuple(
            one
            for one in found.parted
            if not self.hold(np.array([one.metres, 0.0, 0.0]), one.start_gps_s, one.end_gps_s)
        )
        return replace(found, parted=parted, aside=found.aside if parted else ())


def larger_errors(fixes: Fixes, result: FusionResult, options: FusionOptions) -> LargerErrors:
    """Those of the ``fixes`` that the ``result`` was made of."""
    if result.worse is None:
        return LargerErrors(fixes, np.zeros(0), np.zeros((0, 3)))
    there = result.worse.there
    plain, _ = position_errors(fixes, np.ones(len(fixes)), options)
    told = there[:, None] | np.isfinite(fixes.sd_pos_ned)
    stated = np.where(told, plain * result.worse.factor[:, None], np.nan)
    stating = replace(fixes, sd_pos_ned=stated)
    shown = as_shown(model_fixes(stating, fixes.gps_s, options), options, result.noise_factors)
    rows = np.flatnonzero(there[shown.row])
    sizes = lasting_share(options, result.noise_factors, quick_factor(result.worse.times, options))
    sizes /= lasting_share(options, result.noise_factors)
    lasting = shown.stated_sd[rows] / result.worse.factor[shown.row[rows]][:, None] * sizes
    sd = np.sqrt(shown.white_var[rows, :3] + lasting**2)
    return LargerErrors(stating, shown.t[rows], sd, WINDOWS * options.multipath_tau_s)
