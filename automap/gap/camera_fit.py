"""A camera model fitted to boxes of tracked signs: robust Gauss-Newton.

The signs' own unknowns are eliminated one by one (Schur complement: Triggs et al., Bundle
Adjustment, 2000). Boxes far off count less (Huber).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.gap.camera_views import (
    N_LOCAL,
    SIZE_LOG_SD,
    Boxes,
    derivatives,
    foretell,
)
from automap.gap.evidence import Scores
from automap.records import FloatArray, IntArray

HUBER = 2.0
ITERATIONS = 12
HALVINGS = 6
SETTLED_NATS = 0.02
USUAL_SIZE_M = 0.7
PLACE_SD_M = 1e3
NOISE_A_PX = (0.2, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.5, 7.0)
NOISE_B = (0.0, 0.01, 0.02, 0.035, 0.05, 0.08, 0.12, 0.2)


@dataclass(frozen=True)
class CameraFit:
    """A model on the boxes: shared parameters [g], the signs' own [s, 7], robust ``cost`` in nats
    with all priors, whitened residuals [n, 3], and the scores of the shared parameters, the
    signs being the blocks."""

    boxes: Boxes
    sd: FloatArray
    common: FloatArray
    local: FloatArray
    cost: float
    residual: FloatArray
    scores: Scores


def box_noise(boxes: Boxes, a_px: FloatArray, b: FloatArray) -> FloatArray:
    """One sigma [n, 3] of the measurements: ``a_px`` [2] px of centre and height, and the shares
    ``b`` [2] of the box's height that they err by."""
    focal = 0.5 * (boxes.camera.matrix[0, 0] + boxes.camera.matrix[1, 1])
    centre = np.hypot(a_px[0] / focal, b[0] * boxes.height)
    size = np.hypot(a_px[1] / focal / boxes.height, b[1])
    return np.column_stack([centre, centre, size])


def estimate_noise(fit: CameraFit) -> FloatArray:
    """One sigma [n, 3] that suits a fit's residuals best, by likelihood over a grid."""
    raw = fit.residual * fit.sd
    a, b = np.zeros(2), np.zeros(2)
    for part, columns in enumerate(((0, 1), (2,))):
        best = np.inf
        for pixels in NOISE_A_PX:
            for share in NOISE_B:
                sd = box_noise(fit.boxes, np.full(2, pixels), np.full(2, share))[:, columns]
                u = np.abs(raw[:, columns] / sd)
                loss = np.where(u < HUBER, 0.5 * u**2, HUBER * u - 0.5 * HUBER**2)
                cost = float((loss + np.log(sd)).sum())
                if cost < best:
                    best, a[part], b[part] = cost, pixels, share
    return box_noise(fit.boxes, a, b)


def fit_camera(
    boxes: Boxes,
    sd: FloatArray,
    effect_sd: FloatArray,
    start: FloatArray | None = None,
    local: FloatArray | None = None,
) -> CameraFit:
    """Fit the camera to the boxes.

    ``sd`` [n, 3] of the measurements; ``effect_sd`` [g] prior of the shared parameters, zero
    where they keep their value of ``start`` [g] (default zero); ``local`` [s, 7] a start.
    """
    prior = np.where(np.isfinite(boxes.prior_sd()), boxes.prior_sd(), effect_sd)
    common = np.zeros(boxes.n_common) if start is None else start.copy()
    # the priors of effects lie about nothing, not about the start
    if local is None:
        local = _first_places(boxes)
        common, local = _iterate(boxes, sd, common, local, np.zeros_like(prior))
    common, local = _iterate(boxes, sd, common, local, prior)
    residual = (boxes.measured - foretell(boxes, common, local)) / sd
    cost = _cost(residual, common, local, boxes, prior)
    return CameraFit(
        boxes, sd, common, local, cost, residual, _scores(boxes, sd, common, local, prior)
    )


def _first_places(boxes: Boxes) -> FloatArray:
    """Signs of the usual size where their largest box shows them."""
    from automap.frames import rpy_to_matrix

    C = rpy_to_matrix(boxes.camera.mount_rpy)
    out = np.zeros((boxes.n_signs, N_LOCAL))
    for s in range(boxes.n_signs):
        rows = np.flatnonzero(boxes.sign == s)
        i = rows[np.argmax(boxes.height[rows])]
        depth = USUAL_SIZE_M / boxes.height[i]
        ray = depth * np.array([1.0, *boxes.measured[i, :2]])
        out[s, :3] = boxes.pos[i] + boxes.dcm[i] @ (boxes.camera.lever_arm_m + C @ ray)
        out[s, 3] = np.log(USUAL_SIZE_M)
    return out


def _local_prior(boxes: Boxes) -> FloatArray:
    sd = [PLACE_SD_M] * 3 + [SIZE_LOG_SD] + [boxes.velocity_sd] * 3
    return np.array(sd) ** -2.0


def _local_off(local: FloatArray) -> FloatArray:
    """The signs' own parameters [s, 7] against their priors' means; places have none."""
    off = local.copy()
    off[:, :3] = 0.0
    off[:, 3] -= np.log(USUAL_SIZE_M)
    return off


def _loss(u: FloatArray) -> FloatArray:
    return np.where(u < HUBER, 0.5 * u**2, HUBER * u - 0.5 * HUBER**2)


def _cost(
    residual: FloatArray, common: FloatArray, local: FloatArray, boxes: Boxes, prior: FloatArray
) -> float:
    if not np.isfinite(residual).all():
        return np.inf
    total = float(_loss(np.hypot(residual[:, 0], residual[:, 1])).sum())
    total += float(_loss(np.abs(residual[:, 2])).sum())
    free = prior > 0.0
    total += 0.5 * float(((common[free] / prior[free]) ** 2).sum())
    return total + 0.5 * float((_local_off(local) ** 2 * _local_prior(boxes)).sum())


def _weights(residual: FloatArray) -> FloatArray:
    """Roots of the weights [n, 3]."""
    aside = HUBER / np.maximum(np.hypot(residual[:, 0], residual[:, 1]), HUBER)
    size = HUBER / np.maximum(np.abs(residual[:, 2]), HUBER)
    return np.sqrt(np.column_stack([aside, aside, size]))


@dataclass(frozen=True)
class _Equations:
    """Of each sign: ``solved`` [7, g + 1] own normal equations against the shared ones, ``info``
    [g, g] and ``right`` [g] of the shared, the own parameters eliminated."""

    solved: list[FloatArray]
    info: FloatArray
    right: FloatArray


def _equations(
    boxes: Boxes, sd: FloatArray, common: FloatArray, local: FloatArray, active: IntArray
) -> _Equations:
    residual = (boxes.measured - foretell(boxes, common, local)) / sd
    root = _weights(residual) / sd
    by_common, by_local = derivatives(boxes, common, local)
    B = by_common[:, :, active] * root[:, :, None]
    A = by_local * root[:, :, None]
    r = residual * sd * root
    prior, off = _local_prior(boxes), _local_off(local)
    g = B.shape[2]
    infos = np.zeros((boxes.n_signs, g, g))
    rights = np.zeros((boxes.n_signs, g))
    solved = []
    order = np.argsort(boxes.sign, kind="stable")
    edges = np.searchsorted(boxes.sign[order], np.arange(boxes.n_signs + 1))
    for s in range(boxes.n_signs):
        rows = order[edges[s] : edges[s + 1]]
        m = 3 * len(rows)
        a, b = A[rows].reshape(m, N_LOCAL), B[rows].reshape(m, g)
        e = r[rows].reshape(-1)
        both = np.column_stack([a.T @ b, a.T @ e - prior * off[s]])
        answer = np.linalg.solve(a.T @ a + np.diag(prior + 1e-12), both)
        infos[s] = b.T @ b - both[:, :-1].T @ answer[:, :-1]
        rights[s] = b.T @ e - both[:, :-1].T @ answer[:, -1]
        solved.append(answer)
    return _Equations(solved, infos, rights)


def _iterate(
    boxes: Boxes, sd: FloatArray, common: FloatArray, local: FloatArray, prior: FloatArray
) -> tuple[FloatArray, FloatArray]:
    active: IntArray = np.flatnonzero(prior > 0.0).astype(np.int64)

    def cost_of(c: FloatArray, o: FloatArray) -> float:
        return _cost((boxes.measured - foretell(boxes, c, o)) / sd, c, o, boxes, prior)

    cost = cost_of(common, local)
    for _ in range(ITERATIONS):
        equations = _equations(boxes, sd, common, local, active)
        inverse = prior[active] ** -2.0
        info = equations.info.sum(axis=0) + np.diag(inverse)
        right = equations.right.sum(axis=0) - inverse * common[active]
        move = np.linalg.solve(info, right) if len(active) else np.zeros(0)
        own = np.array([a[:, -1] - a[:, :-1] @ move for a in equations.solved])
        factor, better = 1.0, np.inf
        for _ in range(HALVINGS):
            tried = common.copy()
            tried[active] += factor * move
            better = cost_of(tried, local + factor * own)
            if better < cost or (not np.isfinite(cost) and np.isfinite(better)):
                break
            factor *= 0.5
        if not better < cost:
            break
        gained = cost - better
        common, local, cost = tried, local + factor * own, better
        if gained < SETTLED_NATS:
            break
    return common, local


def _scores(
    boxes: Boxes, sd: FloatArray, common: FloatArray, local: FloatArray, prior: FloatArray
) -> Scores:
    """Scores of all shared parameters about zero nuisances, the effects at their values."""
    every = np.arange(boxes.n_common, dtype=np.int64)
    equations = _equations(boxes, sd, common, local, every)
    nuisance = np.where(np.isfinite(boxes.prior_sd()), common, 0.0)
    blocks = equations.right + equations.info @ nuisance
    return Scores(blocks.sum(axis=0), equations.info.sum(axis=0), blocks, equations.info)
