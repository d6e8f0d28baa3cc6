"""Which candidates of a screening are worth a fit."""

from __future__ import annotations

from collections.abc import Collection

from automap.gap.naming import OFFSETS
from automap.gap.screening import Candidate, Screening
from automap.gap.search_state import MIN_NATS

ALIKE = (
    (
        "gnss_latency",
        "imu_time_offset",
        "gnss_velocity_latency",
        "gnss_velocity_lag",
        "imu_clock_skew",
    ),
    ("gnss_lever_arm", "nhc_lever_arm", "vehicle_sideslip"),
    ("accel_misalignment", "imu_mounting"),
)
"""Families that a noisy screening mixes up: when one leads, all are fitted."""
SHORTLIST = 5
SCATTERED_SHORTLIST = 2
SHORTLIST_SHARE = 0.3


def shortlist(
    screening: Screening, accepted: Collection[str] = (), most: int = SHORTLIST
) -> list[Candidate]:
    """The candidates worth a fit of their own, and those that look like the strongest or like an
    effect that was accepted, which may have taken their part; of two that differ in sign alone,
    one. While more than one effect is missing, scores scatter, not of all candidates alike: those
    that lead but for that are worth a fit too."""
    candidates = screening.candidates
    if not candidates or candidates[0].evidence.nats < 0.5 * MIN_NATS:
        return []
    least = max(0.25 * MIN_NATS, SHORTLIST_SHARE * candidates[0].evidence.nats)
    out = [c for c in candidates if c.evidence.nats >= least][:most]
    bare = sorted(candidates, key=lambda c: -c.evidence.uncorrected)[:SCATTERED_SHORTLIST]
    ahead = out[0].evidence.uncorrected
    out += [c for c in bare if c.evidence.uncorrected > ahead and c not in out]
    alike = {e for family in ALIKE for e in family if candidates[0].effect in family}
    out += [c for c in candidates if c.effect in alike and c not in out]
    alike = {e for family in ALIKE for e in family if set(family) & set(accepted)}
    out += [c for c in candidates if c.effect in alike and c not in out and c.evidence.nats > 0.0]
    twins = [c for c in out if c.effect in OFFSETS]
    return [c for c in out if c not in twins[1:]]
