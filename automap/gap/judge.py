"""For which of two sets drives speak: those that were fitted, held-out ones, the receiver alone."""

from __future__ import annotations

from collections.abc import Sequence

from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit
from automap.gap.noise import Fitted
from automap.gap.scoring import fit_held_out, likelier
from automap.gap.whitening import LOOSE


class Judge:
    """Compares sets on the drives that they were fitted to and on others, ``held_out``: nats by
    which these are likelier with one set than with another, and the sigmas of that."""

    def __init__(self, held_out: Sequence[OpenDrive]) -> None:
        self.held_out = held_out
        self._known: list[tuple[Fitted, list[Fit]]] = []

    def ahead(self, one: Fitted, other: Fitted, of_vehicle: bool) -> tuple[float, float]:
        """By all drives: nothing where the sets differ by nothing ``of_vehicle`` and the receiver
        alone says the opposite. A body that sways against its path turns the gyro with it, and
        what is made of small turn rates follows that."""
        nats, sigmas = likelier(self._fits(one), self._fits(other))
        if not of_vehicle and self.by_receiver(one, other)[0] * nats < 0.0:
            return 0.0, 0.0
        return nats, sigmas

    def by_receiver(self, one: Fitted, other: Fitted) -> tuple[float, float]:
        """The same without what the vehicle constraint says."""
        return likelier(self._fits(one), self._fits(other), LOOSE)

    def forget(self) -> None:
        """Forget fits: they are large, and seldom one is asked for again."""
        self._known = []

    def _fits(self, fitted: Fitted) -> list[Fit]:
        return [*fitted.fits, *self._held_out(fitted)]

    def _held_out(self, fitted: Fitted) -> list[Fit]:
        """Held-out drives under a fitted set; those of the last set but one are kept."""
        for known, fits in self._known:
            if known is fitted:
                return fits
        fits = fit_held_out(self.held_out, fitted.model, fitted.values())
        self._known = [*self._known[-1:], (fitted, fits)]
        return fits
