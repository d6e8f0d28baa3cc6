"""What a formula explains more than the names whose place it may have, each fitted.

Each side has the noise that suits it, data without the vehicle constraint are asked too, and data
that neither was fitted to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from automap.gap.fit import Fit
from automap.gap.formula_effect import unconstrained
from automap.gap.heldout import fit_held_out, suiting_score
from automap.gap.scoring import robust_score, whitener_of
from automap.gap.search_state import MIN_NATS, Say, State, estimated, fit_all


def gain(after: Sequence[Fit], before: Sequence[Fit]) -> float:
    """Log-likelihood of fits over others', nats."""
    total = 0.0
    for a, b in zip(after, before, strict=True):
        whitener = whitener_of(a)
        total += robust_score(a, whitener) - robust_score(b, whitener)
    return total


def take_its_noise(named: State, told: State, say: Say) -> bool:
    """Give names the noise that was fitted to a formula, where that suits them better than their
    own by more than scatter: what is compared is what both explain, not how well their noise was
    fitted. Whether it does."""
    model = replace(told.model, values=named.model.values)
    fits = fit_all(named, model, named.accepted)
    more = gain(fits, named.fits)
    if more < MIN_NATS:
        return False
    say(f"with the noise that suits the formula the names explain {more:.1f} nats more")
    named.model, named.fits = model, fits
    return True


def unconstrained_gain(told: State, named: State, say: Say) -> float:
    """How much likelier measurements without the vehicle constraint, which bends the two
    differently, are with the formula than with the names, nats."""
    more = gain(unconstrained(told).fits, unconstrained(named).fits)
    say(f"without the vehicle constraint the formula explains {more:.1f} nats more")
    return more


def held_out_gain(told: State, named: State, say: Say) -> float:
    """How much likelier held-out data are with the formula than with the names, nats."""
    if not named.held_out:
        return 0.0
    before, after = (
        suiting_score(
            partial(fit_held_out, named.held_out, values=estimated(one), near=named.held_fits),
            (named.model, told.model),
            whitener_of(told.fits[0]),
        )
        for one in (named, told)
    )
    say(f"held-out data are {after - before:.1f} nats likelier with the formula")
    return after - before
