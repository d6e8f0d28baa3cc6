"""What a formula explains more than the names whose place it may have, each fitted.

Each side has the noise that suits it, data without the vehicle constraint are asked too, and data
that neither was fitted to.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from automap.gap.formula_effect import unconstrained
from automap.gap.heldout import fit_held_out, score_under_better_noise
from automap.gap.scoring import log_likelihood_ratio, whitener_of
from automap.gap.search_state import MIN_NATS, Log, State, estimated, fit_all


def take_formulas_noise(with_names: State, with_formula: State, log: Log) -> bool:
    """Give names the noise that was fitted to a formula, where that suits them better than their
    own by more than scatter: what is compared is what both explain, not how well their noise was
    fitted. Whether it does."""
    model = replace(with_formula.model, values=with_names.model.values)
    fits = fit_all(with_names, model, with_names.accepted)
    more = log_likelihood_ratio(fits, with_names.fits)
    if more < MIN_NATS:
        return False
    log(f"with the noise that suits the formula the names explain {more:.1f} nats more")
    with_names.model, with_names.fits = model, fits
    return True


def unconstrained_gain(with_formula: State, with_names: State, log: Log) -> float:
    """How much likelier measurements without the vehicle constraint, which bends the two
    differently, are with the formula than with the names, nats."""
    more = log_likelihood_ratio(unconstrained(with_formula).fits, unconstrained(with_names).fits)
    log(f"without the vehicle constraint the formula explains {more:.1f} nats more")
    return more


def held_out_gain(with_formula: State, with_names: State, log: Log) -> float:
    """How much likelier held-out data are with the formula than with the names, nats."""
    if not with_names.held_out:
        return 0.0
    before, after = (
        score_under_better_noise(
            partial(
                fit_held_out,
                with_names.held_out,
                values=estimated(one),
                linearised_at=with_names.held_fits,
            ),
            (with_names.model, with_formula.model),
            whitener_of(with_formula.fits[0]),
        )
        for one in (with_names, with_formula)
    )
    log(f"held-out data are {after - before:.1f} nats likelier with the formula")
    return after - before
