"""Whether what bearings say of a sign's distance and what the heights of its boxes say agree.

The crossing of bearings and the heights of boxes with the usual size of the class are two
measurements of one distance that know nothing of one another. A few boxes of a sign whose size is
not that of its class, a box of something else that happens to fit, or a sign on a lorry make them
contradict. The estimate believes the better one and states the sigma of that; where both cannot
be right it is not known which one is, and the place is no surer than the two are apart, each as
likely as the other's error is (the tails being those of the loss of the estimate).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior, fit_landmark
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.views import Views
from automap.records import FloatArray
from automap.robust import cauchy_loss


@dataclass(frozen=True)
class Disagreement:
    """``square`` squared difference of the two logarithms of the distance in sigmas, one degree
    of freedom; ``spread`` [3, 3] m^2 mean square of the two places, by how likely each is, about
    the landmark's, in the local frame."""

    square: float
    spread: FloatArray

    @property
    def contradictory(self) -> bool:
        """Whether chance does not make the two differ so much."""
        return self.square > gate(limits.CONTRADICTION_PROBABILITY, 1)


AGREED = Disagreement(0.0, np.zeros((3, 3)))
"""Of a sign of which nothing can be compared."""


def disagreement(views: Views, landmark: Landmark, prior: SizePrior) -> Disagreement:
    """Bearings against heights of one settled ``landmark``, with the ``prior`` of its size.

    Where either alone leads nowhere (a single view, or parallel bearings) nothing disagrees.
    """
    if len(landmark.rows) < 2:
        return AGREED
    aside = limits.SET_ASIDE
    parts = [
        solve_with_pass_errors(seen, fit_landmark(seen, landmark.rows, known), known)
        for seen, known in (
            (replace(views, sd=views.sd * [1.0, 1.0, aside]), SizePrior(log_sd=aside)),
            (replace(views, sd=views.sd * [aside, aside, 1.0]), prior),
        )
    ]
    if not all(part.ok for part in parts):
        return AGREED
    variance = np.array([part.depth_log_sd**2 for part in parts])
    off = np.array([part.parameters[2] - landmark.parameters[2] for part in parts])
    apart = float(np.diff(off)[0] ** 2)
    # if one is right the other is off by all of the difference, with the tails of the loss
    likely = np.exp(-0.5 * cauchy_loss(apart / variance[::-1]))
    # along the landmark's own ray: without bearings a direction means nothing
    ray = landmark.position - views.centre[landmark.anchor]
    square = float(likely @ np.expm1(off) ** 2 / likely.sum())
    return Disagreement(float(apart / variance.sum()), square * np.outer(ray, ray))
