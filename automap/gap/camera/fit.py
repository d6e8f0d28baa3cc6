"""A camera model fitted to boxes of tracked signs.

Geolocation's estimator gives each sign's place and its normal equations with the camera as it
would be; the signs' own unknowns are eliminated one by one (Schur complement: Triggs et al.,
Bundle Adjustment, 2000), and the views are made anew with the camera that comes out. Boxes far off
count less (Huber).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.effects.camera import by_parameters
from automap.effects.camera_kernels import N_COLUMNS, TURN
from automap.effects.lens import focal_length
from automap.effects.measured import Values
from automap.gap.camera.views import Boxes, keys
from automap.geolocation.landmark import (
    SizePrior,
    boxes_of,
    columns_of,
    fit_landmark,
    place,
    seen_from,
    sign_equations,
)
from automap.geolocation.landmark_kernels import MARGIN, N_COMMON
from automap.geolocation.views import Views
from automap.records import FloatArray, IntArray
from automap.robust import BY_HUBER, HUBER_SHARE, huber_loss

N_LOCAL = 7
"""Of a sign: place NED, logarithm of its size, error of the velocity while it passes."""
ITERATIONS = 12
HALVINGS = 6
SETTLED_NATS = 0.02
SIZE = SizePrior(0.7, 1.0)
"""Hardly known: what the focal length is worth must not come from sizes."""
NOISE_A_PX = (0.2, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.5, 7.0)
NOISE_B = (0.0, 0.01, 0.02, 0.035, 0.05, 0.08, 0.12, 0.2)
VELOCITY = slice(9, 12)
"""Place of the velocity's error among what is common to the views of a sign."""


@dataclass(frozen=True)
class CameraFit:
    """A model on the boxes: shared parameters [g], the signs' own [s, 7], robust ``cost`` in nats
    with all priors, whitened residuals [n, 3] of boxes of one sigma ``sd`` [n, 3],
    ``prior_sd`` [g] of the shared parameters, zero of what does not act, and of each sign their
    normal equations, ``info`` [s, g, g] and ``right`` [s, g] of a step from where they are."""

    boxes: Boxes
    sd: FloatArray
    common: FloatArray
    local: FloatArray
    cost: float
    residual: FloatArray
    prior_sd: FloatArray
    info: FloatArray
    right: FloatArray

    def cost_by_sign(self) -> FloatArray:
        """Nats [s] of each sign's boxes, without priors."""
        square = self.residual**2
        each = huber_loss(square[:, 0] + square[:, 1]) + huber_loss(square[:, 2])
        sums = np.bincount(self.boxes.sign, each, minlength=self.boxes.n_signs)
        return np.asarray(0.5 * sums, np.float64)


def box_noise(boxes: Boxes, a_px: FloatArray, b: FloatArray) -> FloatArray:
    """One sigma [n, 3] of the measurements: ``a_px`` [2] px of centre and height, and the shares
    ``b`` [2] of the box's height that they err by."""
    focal = focal_length(boxes.camera)
    box = np.concatenate([d.found.box for d in boxes.drives])
    height = (box[:, 3] - box[:, 1]) / focal
    centre = np.hypot(a_px[0] / focal, b[0] * height)
    size = np.hypot(a_px[1] / focal / height, b[1])
    return np.column_stack([centre, centre, size])


def estimate_noise(fit: CameraFit) -> FloatArray:
    """One sigma [n, 3] that suits a fit's residuals best, over a grid; consistent where they are
    normal (Huber's proposal 2: Robust Statistics, 1981, chapter 6)."""
    raw = fit.residual * fit.sd
    a, b = np.zeros(2), np.zeros(2)
    for part, columns in enumerate(((0, 1), (2,))):
        best = np.inf
        for pixels in NOISE_A_PX:
            for share in NOISE_B:
                sd = box_noise(fit.boxes, np.full(2, pixels), np.full(2, share))[:, columns]
                loss = 0.5 * huber_loss((raw[:, columns] / sd) ** 2) / HUBER_SHARE
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
    """Fit the camera to the boxes by Gauss-Newton steps.

    ``sd`` [n, 3] of the measurements; ``effect_sd`` [g] prior of the shared parameters, zero
    where they keep their value of ``start`` [g] (default zero); ``local`` [s, 7] a start.
    """
    prior = np.where(np.isfinite(boxes.prior_sd()), boxes.prior_sd(), effect_sd)
    common = np.zeros(boxes.n_common) if start is None else start.copy()
    # the priors of effects lie about nothing, not about the start
    if local is None:
        local = _first_places(boxes, sd, common)
        start_at = _descend(_evaluated(boxes, sd, common, local, np.zeros_like(prior)))
        common, local = start_at.common, start_at.local
    at = _descend(_evaluated(boxes, sd, common, local, prior))
    return CameraFit(boxes, sd, at.common, at.local, at.cost, at.residual, prior, at.info, at.right)


def _views(boxes: Boxes, sd: FloatArray, values: Values) -> Views | None:
    views = boxes.views(values)
    return None if views is None else replace(views, sd=sd)


def _values(common: FloatArray) -> Values:
    """The shared parameters that are errors of the camera."""
    out: dict[str, dict[str, float]] = {}
    for (effect, parameter), value in zip(keys(), common, strict=False):
        if value != 0.0:
            out.setdefault(effect, {})[parameter] = float(value)
    return out


def _first_places(boxes: Boxes, sd: FloatArray, common: FloatArray) -> FloatArray:
    """Signs where geolocation puts them."""
    views = _views(boxes, sd, _values(common))
    out = np.zeros((boxes.n_signs, N_LOCAL))
    if views is not None:
        for s, rows in enumerate(_rows_by_sign(boxes)):
            mark = fit_landmark(views, rows, SIZE)
            out[s, :4] = *mark.position, mark.parameters[3]
    return out


def _rows_by_sign(boxes: Boxes) -> list[IntArray]:
    order = np.argsort(boxes.sign, kind="stable")
    return np.split(order, np.searchsorted(boxes.sign[order], np.arange(1, boxes.n_signs)))


@dataclass(frozen=True)
class _At:
    """The model at some parameters: its cost, residuals [n, 3] in sigmas, and of each sign
    ``solved`` [7, g + 1] own normal equations against the shared ones, ``info`` [g, g] and
    ``right`` [g] of the shared, the own parameters eliminated. Without views the cost is infinite
    and the rest is zero."""

    boxes: Boxes
    sd: FloatArray
    common: FloatArray
    local: FloatArray
    prior: FloatArray
    cost: float
    views: Views | None
    residual: FloatArray
    solved: FloatArray
    info: FloatArray
    right: FloatArray


def _evaluated(
    boxes: Boxes,
    sd: FloatArray,
    common: FloatArray,
    local: FloatArray,
    prior: FloatArray,
    near: _At | None = None,
) -> _At:
    """The model there; views of ``near`` serve again where the camera is the same."""
    n_effects, g = len(keys()), boxes.n_common
    nothing = (np.zeros((boxes.n_signs, N_LOCAL, g + 1)), np.zeros((boxes.n_signs, g, g)))
    nowhere = _At(
        *(boxes, sd, common, local, prior, np.inf, None, np.zeros((len(sd), 3))),
        *(*nothing, np.zeros((boxes.n_signs, g))),
    )
    values = _values(common)
    same = near is not None and _values(near.common) == values
    views = near.views if near is not None and same else _views(boxes, sd, values)
    if views is None:
        return nowhere
    size = np.log(SIZE.size_m)
    free = prior > 0.0
    cost = 0.5 * float(((common[free] / prior[free]) ** 2).sum())
    cost += 0.5 * float(huber_loss(((local[:, 3] - size) / SIZE.log_sd) ** 2).sum())
    cost += 0.5 * float((local[:, 4:] ** 2).sum()) / boxes.velocity_sd**2
    signs = _rows_by_sign(boxes)
    shared, effects = np.zeros((len(sd), 3, N_COMMON)), np.zeros((len(sd), 3, N_COLUMNS))
    seen = np.zeros((boxes.n_signs, 4))
    for s, (rows, anchor) in enumerate(zip(signs, boxes.anchor.tolist(), strict=True)):
        parameters = seen_from(views, anchor, local[s, :3], local[s, 3])
        if parameters is None:
            return nowhere
        seen[s] = parameters
        shared[rows], effects[rows] = columns_of(views, rows, anchor, parameters, own=True)
    every = np.concatenate(
        [
            *(by_parameters(values, effects), boxes.by_users(effects)),
            shared[:, :, MARGIN : MARGIN + 1],
            effects[:, :, TURN : TURN + 3] @ views.C_cam_body,
            shared[:, :, VELOCITY],
        ],
        axis=2,
    )
    residual = np.zeros((len(sd), 3))
    solved = np.zeros((boxes.n_signs, N_LOCAL, g + 1))
    info, right = np.zeros((boxes.n_signs, g, g)), np.zeros((boxes.n_signs, g))
    for s, (rows, anchor) in enumerate(zip(signs, boxes.anchor.tolist(), strict=True)):
        # place of each column among the shared parameters; an attitude error has two parts
        first = n_effects + 1
        minute = first + 3 + 3 * int(boxes.window[s])
        wander = common[first : first + 3] + common[minute : minute + 3]
        bias = np.concatenate([np.zeros(n_effects), common[n_effects:first], wander, local[s, 4:]])
        # errors that do not depend on what is fitted: models are compared by their likelihoods
        own_boxes = boxes_of(views, rows, anchor, SIZE)
        N, A, S, residual[rows], *_ = sign_equations(
            seen[s], own_boxes, every[rows], bias, BY_HUBER
        )
        m = every.shape[2]
        own = np.concatenate([np.arange(m, m + 4), np.arange(m - 3, m)])
        whole = np.block([[S[:m, :m], A.T, S[:m, m:]], [A, N, S[m:, m:]]])
        whole[m - 3 : m, m - 3 : m] += np.eye(3) / boxes.velocity_sd**2
        whole[m - 3 : m, -1] -= local[s, 4:] / boxes.velocity_sd**2
        inside = np.array([*range(first + 3), *range(first, first + 3)])
        with_right = np.append(inside, m + 4)
        places = np.array([*range(first + 3), *range(minute, minute + 3)])
        both = whole[np.ix_(own, with_right)]
        answer = np.linalg.solve(whole[np.ix_(own, own)] + 1e-12 * np.eye(N_LOCAL), both)
        reduced = whole[np.ix_(inside, with_right)] - both[:, :-1].T @ answer
        solved[s][:, places], solved[s][:, -1] = answer[:, :-1], answer[:, -1]
        info[s][np.ix_(places, places)], right[s][places] = reduced[:, :-1], reduced[:, -1]
    if not np.isfinite(residual).all():
        return nowhere
    square = residual**2
    cost += 0.5 * float(
        huber_loss(square[:, 0] + square[:, 1]).sum() + huber_loss(square[:, 2]).sum()
    )
    return _At(boxes, sd, common, local, prior, cost, views, residual, solved, info, right)


def _descend(at: _At) -> _At:
    active = np.flatnonzero(at.prior > 0.0)
    for _ in range(ITERATIONS):
        if at.views is None:
            break
        inverse = at.prior[active] ** -2.0
        info = at.info.sum(axis=0)[np.ix_(active, active)] + np.diag(inverse)
        right = at.right.sum(axis=0)[active] - inverse * at.common[active]
        move = np.linalg.solve(info, right) if len(active) else np.zeros(0)
        own = at.solved[:, :, -1] - at.solved[:, :, active] @ move
        factor, better = 1.0, at
        for _ in range(HALVINGS):
            common = at.common.copy()
            common[active] += factor * move
            local = _moved(at, factor * own)
            tried = _evaluated(at.boxes, at.sd, common, local, at.prior, at)
            if tried.cost < at.cost:
                better = tried
                break
            factor *= 0.5
        gained = at.cost - better.cost
        at = better
        if gained < SETTLED_NATS:
            break
    return at


def _moved(at: _At, step: FloatArray) -> FloatArray:
    """The signs' own parameters after steps [s, 7] of the anchors' parameters and velocities."""
    assert at.views is not None
    out = at.local.copy()
    out[:, 4:] += step[:, 4:]
    for s, anchor in enumerate(at.boxes.anchor.tolist()):
        before = seen_from(at.views, anchor, at.local[s, :3], at.local[s, 3])
        assert before is not None
        after = before + step[s, :4]
        out[s, :3], out[s, 3] = place(at.views, anchor, after), after[3]
    return out
