"""Levels of noise under which fitted drives are looked at: those that suit them, and others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

from automap.fusion.adapt import scale_nodes, scale_problem
from automap.fusion.layout import NHC
from automap.fusion.levels import ALL_LEVELS
from automap.gap.fit import Fit
from automap.gap.noise import fit_noise, noise_score, rooms_of
from automap.records import FloatArray


class Levels:
    """Fitted drives under levels of noise: those that suit them, ``factors``, and others."""

    def __init__(
        self,
        fits: Sequence[Fit],
        curvature: FloatArray | None = None,
        factors: Mapping[str, float] | None = None,
    ) -> None:
        """``curvature`` of the likelihood along all levels, its inverse, as far as that is known;
        ``factors`` those of the fits where others are not given."""
        self.fits, self.curvature = fits, curvature
        self.factors = dict(factors or fits[0].model.factors)
        self._rooms = rooms_of(fits)
        self._known: dict[tuple[float, ...], float] = {}

    @cached_property
    def free(self) -> Levels:
        """The same where nothing is known of how the vehicle moves: a body that sways against its
        path looks like noise of the sensors in it."""
        fits = [_unconstrained(fit) for fit in self.fits]
        factors = fit_noise(fits, initial=self.factors, curvature=self.curvature)
        return Levels(fits, self.curvature, factors)

    def score(self, factors: Mapping[str, float]) -> float:
        """Log-likelihood of the drives under other factors, nats, worked out once for the same."""
        key = tuple(factors[level] for level in ALL_LEVELS)
        if key not in self._known:
            self._known[key] = noise_score(self.fits, factors, self._rooms)
        return self._known[key]

    def loss(self, as_stated: Mapping[str, float]) -> float:
        """Nats by which drives are less likely with levels ``as_stated``, all others moved to where
        they suit the drives then: what another can say as well is no evidence for one."""
        others = [level for level in ALL_LEVELS if level not in as_stated]
        held = fit_noise(self.fits, others, {**self.factors, **as_stated}, self.curvature)
        return self.score(self.factors) - self.score(held)

    def scaled(self) -> list[Fit]:
        """The fits as they are under these levels."""
        relative = {k: v / self.fits[0].model.factors[k] for k, v in self.factors.items()}
        out = []
        for fit in self.fits:
            problem = scale_problem(fit.last.problem, relative)
            nodes = scale_nodes(fit.last.nodes, relative)
            out.append(replace(fit, last=replace(fit.last, problem=problem, nodes=nodes)))
        return out


def _unconstrained(fit: Fit) -> Fit:
    """A fit whose nodes say nothing of sideways slip and springs."""
    nodes = replace(fit.last.nodes, flags=fit.last.nodes.flags & ~NHC)
    return replace(fit, last=replace(fit.last, nodes=nodes))
