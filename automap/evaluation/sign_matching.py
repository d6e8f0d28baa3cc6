"""One-to-one matching of located signs with truth, and the figures it gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.assignment import assign_near
from automap.earth import ecef
from automap.evaluation.limits import GATES_M, PAIR_GATE_M
from automap.gates import OUTSIDE_95, gate
from automap.records import FloatArray, IntArray, Sign, SignPoints


def points_of(signs: Sequence[Sign]) -> SignPoints:
    """Located signs as points."""
    return SignPoints(
        lat_rad=np.array([s.lat_rad for s in signs], np.float64),
        lon_rad=np.array([s.lon_rad for s in signs], np.float64),
        class_name=np.array([s.class_name for s in signs], np.object_),
        cov_en=np.array([s.cov_enu[:2, :2] for s in signs], np.float64).reshape(-1, 2, 2),
        sd_m=np.zeros(len(signs)),
    )


@dataclass(frozen=True)
class Pairs:
    """Matched pairs: rows of the estimate and of the truth, and their distance in metres."""

    estimate: IntArray
    truth: IntArray
    distance_m: FloatArray

    def __len__(self) -> int:
        return len(self.estimate)


def _on_ellipsoid(points: SignPoints) -> FloatArray:
    """ECEF [n, 3] at height zero: chords are horizontal distances, at the date line too."""
    return ecef(points.lat_rad, points.lon_rad, np.zeros(len(points)))


def match(estimate: SignPoints, truth: SignPoints, gate_m: float) -> Pairs:
    """Match one to one within ``gate_m``, class-blind (Hungarian method).

    A sign left over costs as much as a pair at the gate, so that two poor pairs are not
    preferred to one good one. Distances are horizontal. Far-apart groups of signs are solved
    on their own, which keeps a whole city affordable.
    """
    if len(estimate) == 0 or len(truth) == 0:
        nothing = np.zeros(0, np.int64)
        return Pairs(nothing, nothing.copy(), np.zeros(0))
    from scipy.spatial import cKDTree

    near = cKDTree(_on_ellipsoid(estimate)).sparse_distance_matrix(
        cKDTree(_on_ellipsoid(truth)), gate_m, output_type="coo_matrix"
    )
    rows, columns = near.row.astype(np.int64), near.col.astype(np.int64)
    partner = assign_near(rows, columns, near.data, len(estimate), gate_m)
    apart = {(i, j): d for i, j, d in zip(rows.tolist(), columns.tolist(), near.data, strict=True)}
    paired = np.flatnonzero(partner >= 0)
    return Pairs(
        paired,
        partner[paired],
        np.array([apart[i, int(partner[i])] for i in paired.tolist()], np.float64),
    )


def _coverage95(estimate: SignPoints, truth: SignPoints, pairs: Pairs) -> float | None:
    """Share of pairs whose error lies inside the 95 % ellipse of covariance plus truth error."""
    import pymap3d

    i, j = pairs.estimate, pairs.truth
    covariance = estimate.cov_en[i] + truth.sd_m[j, None, None] ** 2 * np.eye(2)
    known = np.isfinite(covariance).all(axis=(1, 2))
    if not known.any():
        return None
    zero = np.zeros(len(pairs))
    east, north, _ = pymap3d.geodetic2enu(
        *(estimate.lat_rad[i], estimate.lon_rad[i], zero),
        *(truth.lat_rad[j], truth.lon_rad[j], zero),
        deg=False,
    )
    error = np.column_stack([east, north])[known]
    a, b, c = covariance[known, 0, 0], covariance[known, 0, 1], covariance[known, 1, 1]
    determinant = a * c - b * b
    numerator = c * error[:, 0] ** 2 - 2 * b * error[:, 0] * error[:, 1] + a * error[:, 1] ** 2
    return float(np.mean(numerator <= gate(OUTSIDE_95, 2) * determinant))


def summarise_signs(estimate: SignPoints, truth: SignPoints) -> dict[str, Any]:
    """The ``signs`` section of ``evaluation.json``.

    Recall is over all truth signs, precision over all estimated ones; a share of nothing is
    None. Errors, coverage and class accuracy are over the pairs within PAIR_GATE_M.
    """
    gates: dict[str, dict[str, float | None]] = {}
    for limit in GATES_M:
        n = len(match(estimate, truth, limit))
        gates[f"{limit:g}"] = {
            "recall": n / len(truth) if len(truth) else None,
            "precision": n / len(estimate) if len(estimate) else None,
        }
    pairs = match(estimate, truth, PAIR_GATE_M)
    some = len(pairs) > 0
    same = estimate.class_name[pairs.estimate] == truth.class_name[pairs.truth]
    return {
        "gates": gates,
        "median_error_m": float(np.median(pairs.distance_m)) if some else None,
        "mean_error_m": float(np.mean(pairs.distance_m)) if some else None,
        "p95_error_m": float(np.percentile(pairs.distance_m, 95)) if some else None,
        "coverage95": _coverage95(estimate, truth, pairs) if some else None,
        "class_accuracy": float(np.mean(same)) if some else None,
        "n_truth": len(truth),
        "n_estimated": len(estimate),
        "n_pairs": len(pairs),
    }
