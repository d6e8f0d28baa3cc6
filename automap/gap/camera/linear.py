"""A camera's fit made linear in the errors of the camera, in the form that all candidates have.

Of each sign the fit has normal equations in what all signs share, its own unknowns eliminated. Rows
of the same equations (a root of the information) are what innovations are of a drive: white, of
size one. So evidence, selection and chance are those of every other candidate.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from automap.effects import CATALOGUE
from automap.gap.camera.fit import CameraFit
from automap.gap.camera.views import keys
from automap.gap.candidates import candidates_of
from automap.gap.linear import Column, Given, Linear
from automap.gap.rows import Rows
from automap.gap.selection import Selection
from automap.records import FloatArray

PATH = "path"
"""Stands for what is common to signs and no error of the camera: the boxes' margin, the path's
attitude."""
NOTHING = 1e-9
"""Information, in units of a prior's, that says nothing."""


def selection_of(fit: CameraFit, effects: Collection[str]) -> Selection:
    """The fit made linear, and which of ``effects`` may be missing from it."""
    linear = _linear(fit)
    errors = len(keys())
    nuisances = tuple(range(errors, fit.boxes.n_common))
    given = Given(nuisances, tuple(linear.prior_sd[errors:].tolist()))
    candidates = candidates_of(linear.layout[:errors], effects)
    return Selection(linear, {c.name: c for c in candidates if c.name in effects}, always=given)


def _linear(fit: CameraFit) -> Linear:
    boxes = fit.boxes
    sds = boxes.prior_sd()
    usual = {(e, p.name): p.prior_sd for e in dict(keys()) for p in CATALOGUE[e].parameters}
    sds[: len(keys())] = [usual[key] for key in keys()]
    layout = [Column(*key, usual[key]) for key in keys()]
    layout += [Column(PATH, str(i), sd) for i, sd in enumerate(sds[len(layout) :].tolist())]
    # effects and what is common count from zero: what their values explain is given back
    right = fit.right + fit.info @ fit.common
    rows = [
        _root(info, score, sds, float(t))
        for info, score, t in zip(fit.info, right, boxes.t[boxes.anchor], strict=True)
    ]
    by_drive = np.split(np.arange(boxes.n_signs), boxes.first_signs()[1:])
    joined = tuple(_joined([rows[s] for s in signs.tolist()]) for signs in by_drive if len(signs))
    score, info = right.sum(axis=0), fit.info.sum(axis=0)
    return Linear(tuple(layout), joined, None, score, info, sds, fit.common.copy())


def _root(info: FloatArray, score: FloatArray, sds: FloatArray, t: float) -> Rows:
    """Rows whose information and score are those [g, g] and [g] of a sign seen at ``t`` s."""
    values, vectors = np.linalg.eigh(info * np.outer(sds, sds))
    kept = values > NOTHING
    size, vectors = np.sqrt(values[kept]), vectors[:, kept]
    phi = (vectors * size).T / sds
    w = vectors.T @ (sds * score) / size
    return Rows(w, phi, np.full(len(w), t), np.zeros(len(w), np.int64))


def _joined(rows: list[Rows]) -> Rows:
    """Rows of a drive's signs in the order in which these were passed."""
    rows = sorted(rows, key=lambda r: float(r.t[0]) if len(r.t) else 0.0)
    each = ([getattr(r, name) for r in rows] for name in ("w", "phi", "t", "channel"))
    return Rows(*(np.concatenate(parts) for parts in each))


def covariance(fit: CameraFit) -> FloatArray:
    """Covariance [g, g] of what acts in a fit; zero of the rest."""
    out = np.zeros((len(fit.common),) * 2)
    at = np.flatnonzero(fit.prior_sd > 0.0)
    rows = np.ix_(at, at)
    out[rows] = np.linalg.inv(fit.info.sum(axis=0)[rows] + np.diag(fit.prior_sd[at] ** -2.0))
    return out


def log_evidence(fit: CameraFit) -> float:
    """Logarithm of a fit's marginal likelihood in nats, up to what all fits share (Laplace)."""
    at = np.flatnonzero(fit.prior_sd > 0.0)
    sds = fit.prior_sd[at]
    info = fit.info.sum(axis=0)[np.ix_(at, at)] * np.outer(sds, sds)
    return -fit.cost - 0.5 * float(np.linalg.slogdet(info + np.eye(len(at)))[1])
