"""Whether what boxes show is as large as a face of its kind, or a wall, a board, a vehicle.

Boxes that fit one place say that something stands there, whatever it is: the front of a house is
found again as a sign is. How large it is tells what is larger than any face that is made: faces of
a class are about as large as the table says, or of any size up to the largest; such things are as
often of one size above it as of another (log-uniform). Things of a face's size are for boxes to
tell: how often there are any no size says, and a share of them taken off every sign would make the
surest ones doubtful.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from automap.geolocation import limits
from automap.geolocation.class_sizes import measured_size
from automap.geolocation.landmark import Landmark, SizePrior
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.views import Views
from automap.records import FloatArray

_LIMITED = ("warning--", "regulatory--")


def largest_face_m(name: str) -> float:
    """The height of the largest face that is made of a class; infinite for those, boards, plates
    and pictograms, that are as large as what stands on them."""
    return limits.LARGEST_FACE_M if name.startswith(_LIMITED) else np.inf


def face_odds(views: Views, landmarks: Sequence[Landmark], prior: SizePrior) -> FloatArray:
    """Odds [m] that each of some landmarks is a face of a sign, against what is larger than any;
    infinite where the class has no largest face or bearings do not tell the size."""
    nats = np.array([_told(views, mark, prior) for mark in landmarks], np.float64)
    odds = (1.0 / limits.NO_FACE - 1.0) * np.exp(np.clip(nats, -50.0, 50.0))
    return np.where(np.isfinite(nats), odds, np.inf)


def _told(views: Views, mark: Landmark, prior: SizePrior) -> float:
    """What a landmark's size says for a face, nats; NaN where it says nothing."""
    names = views.class_name[mark.rows].tolist()
    largest = max(largest_face_m(str(name)) for name in names)
    if not (mark.ok and np.isfinite(largest)):
        return np.nan
    usual = prior.of(names)

    def nats_of(mark: Landmark) -> float:
        return size_nats(*measured_size(mark, usual, usual.weight(mark)), usual, largest)

    nats = nats_of(mark)
    # the errors of the pass may have made it large
    return nats_of(solve_with_pass_errors(views, mark, prior)) if nats < 0.0 else nats


def size_nats(log_size: float, variance: float, usual: SizePrior, largest_m: float) -> float:
    """Log likelihood ratio of a measured size, of a face against what is larger than any."""
    spread = usual.log_sd**2 + variance
    off = (log_size - np.log(usual.size_m)) ** 2 / spread
    face = (1.0 - limits.ODD_SIZE) * np.exp(-0.5 * off) / np.sqrt(2.0 * np.pi * spread)
    face += limits.ODD_SIZE * _even(log_size, variance, limits.SMALLEST_FACE_M, largest_m)
    thing = _even(log_size, variance, largest_m, limits.LARGEST_THING_M)
    return float(np.log(max(face, 1e-300) / max(thing, 1e-300)))


def _even(log_size: float, variance: float, low_m: float, high_m: float) -> float:
    """Density of a measured size whose true one is log-uniform between two."""
    sd, low, high = np.sqrt(variance), np.log(low_m), np.log(high_m)
    return float((ndtr((high - log_size) / sd) - ndtr((low - log_size) / sd)) / (high - low))
