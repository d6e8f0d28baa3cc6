"""For which of two sets of effects drives speak: those that were fitted, held-out ones, and the
receiver alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit
from automap.gap.noise import Fitted
from automap.gap.scoring import Odds, fit_held_out, likelier_by_side


class Judge:
    """Compares sets on the drives that they were fitted to and on others, ``held_out``: nats by
    which these are likelier with one set than with another, and the sigmas of that."""

    def __init__(self, held_out: Sequence[OpenDrive]) -> None:
        self.held_out = held_out
        self._known: list[tuple[Fitted, list[Fit]]] = []

    def ahead(self, one: Fitted, other: Fitted, of_vehicle: bool, strictly: bool = False) -> Odds:
        """By all drives: where the sets differ by nothing ``of_vehicle`` nothing if the receiver
        alone says the opposite, and ``strictly`` no surer than that is. A body that sways against
        its path turns the gyro with it, and what is made of small turn rates follows that."""
        return _heard(self._fits(one), self._fits(other), of_vehicle, strictly)

    def beyond_drift(self, one: Fitted, other: Fitted, of_vehicle: bool) -> Odds:
        """The same where drift may say what the first set says. On a drive that was fitted it
        follows whatever is slow, each in its own way, so that the two differ there by scatter: for
        the first speaks, too, what held-out drives alone are sure of, where drift begins anew."""
        nats, sigmas = self.ahead(one, other, of_vehicle)
        if nats > 0.0 and self.held_out:
            held = _heard(self._held_out(one), self._held_out(other), of_vehicle, strictly=False)
            sigmas = max(sigmas, held[1])
        return nats, sigmas

    def forget(self) -> None:
        """Forget fits: they are large, and seldom one is asked for again."""
        self._known = []

    def _fits(self, fitted: Fitted) -> list[Fit]:
        return [*fitted.fits, *self._held_out(fitted)]

    def _held_out(self, fitted: Fitted) -> list[Fit]:
        """Held-out drives under a fitted set; the two that were asked for last are kept."""
        known = [one for one in self._known if one[0] is fitted]
        if not known:
            about = self._known[-1][1] if self._known else ()
            fits = fit_held_out(self.held_out, fitted.model, fitted.values(), about)
            known = [(fitted, [_light(fit) for fit in fits])]
        # one that many are compared with stays
        self._known = [*(one for one in self._known if one[0] is not fitted), *known][-2:]
        return known[0][1]


def _heard(one: Sequence[Fit], other: Sequence[Fit], of_vehicle: bool, strictly: bool) -> Odds:
    """By how much drives are likelier under fits than under others, as ``Judge.ahead`` has it."""
    told, received = likelier_by_side(one, other)
    if of_vehicle:
        return told
    if received[0] * told[0] < 0.0:
        return 0.0, 0.0
    return told[0], min(told[1], received[1], key=abs) if strictly else told[1]


def _light(fit: Fit) -> Fit:
    """A fit without what only a linear model asks of it, which is most of its size."""
    store = fit.last.forward.store
    gone = {name: getattr(store, name)[:0].copy() for name in ("h", "gain", "trans")}
    forward = replace(fit.last.forward, store=store._replace(**gone))
    return replace(fit, last=replace(fit.last, forward=forward))
