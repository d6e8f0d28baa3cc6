"""Which candidates of a screening are worth a fit."""

from __future__ import annotations

from collections.abc import Collection

from automap.effects import CATALOGUE
from automap.gap.naming import OFFSETS
from automap.gap.screening import Candidate, Screening
from automap.gap.search_state import MIN_NATS

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
    kind = _kinds([candidates[0].effect])
    out += [c for c in candidates if _kinds([c.effect]) & kind and c not in out]
    kinds = _kinds(accepted)
    rest = [c for c in candidates if c not in out and c.evidence.nats > 0.0]
    out += [c for c in rest if _kinds([c.effect]) & kinds]
    twins = [c for c in out if c.effect in OFFSETS]
    return [c for c in out if c not in twins[1:]]


def _kinds(effects: Collection[str]) -> set[str]:
    """What a noisy screening takes effects for: when one leads, all of its kind are fitted."""
    return {kind for e in effects if (kind := CATALOGUE[e].resembles)}
