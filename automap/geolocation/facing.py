"""Which way signs face: from the widths of their boxes over a pass, and from the road.

A plate that is seen at an angle to its normal is narrower by the cosine of that angle, and the
angle changes while a car passes: the shape of the face is known from its class, so widths over
heights tell the normal. Little where it is looked at squarely, where the cosine is flat. So the
road has a say: faces look against the traffic but for some degrees, and a few to somewhere else;
of signs that stand far aside, as those of a crossing street, most. Seen at a slant such a face has
a mirror image about the line of sight, which explains its widths alike.
How far those of a drive are turned, how its boxes scatter, and how far they are wider or taller
than their faces is measured from the drive's own signs (expectation maximisation, Dempster, Laird
and Rubin, J. R. Statist. Soc. B 39, 1977) and pulled towards stated values where there are few.
Every sign's belief over its normals is kept whole, on a grid: of two normals that
explain its boxes alike the likelier is stated, and the sigma spans both. From afar a turned face
may be too narrow for a detector; that only its widest boxes are found is allowed for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtr

from automap.frames import wrap_pi
from automap.gates import sigmas
from automap.geolocation import limits
from automap.geolocation.box_noise import scatter
from automap.geolocation.path_relation import Path, roads_at
from automap.geolocation.sightings import Sighting
from automap.geolocation.view_errors import crowd, view_sd
from automap.geolocation.views import Views
from automap.records import FloatArray, IntArray
from automap.robust import cauchy_weight
from automap.signs.class_shares import commonest
from automap.signs.outlines import outline_of, outline_points

_ROUNDS = 8
"""Of the expectation maximisation."""
_GRID: FloatArray = np.radians(np.arange(-90.0, 90.5, 1.0))
"""Normals tried, from the mean direction the sign was looked at from: faces are read from in front,
and a degree is a fifth of what the best are known to."""
_OCTAVES = 8
"""Of the sizes of boxes, as directions: from a 256th of the focal length, four pixels, on."""
_OUTSIDE = 0.05
"""Of the belief, beyond the interval that the sigma tells: of 95 %."""
_CIRCLE_POINTS = 24
"""Of a round face: its width is right to 1 - cos(7.5 deg), below a hundredth."""


@dataclass(frozen=True)
class Facing:
    """Direction [rad] clockwise from the local frame's north that a face looks, one sigma."""

    rad: float
    sd_rad: float


@dataclass(frozen=True)
class Faces:
    """What the signs of a drive have in common: ``turned_sd`` [rad] of faces about the direction
    against the traffic, ``elsewhere`` the share that looks somewhere else, ``log_aspect`` [8] by
    how much boxes of each octave of size are wider than their faces, and ``aspect_sd`` from sign to
    sign; ``alike`` the factor on what all boxes of a sign of about one size are stated to err by in
    common, ``scale`` on their scatter."""

    turned_sd: float = limits.TURNED_SD
    elsewhere: float = limits.FACE_ELSEWHERE
    log_aspect: FloatArray = field(default_factory=lambda: np.zeros(_OCTAVES))
    aspect_sd: float = limits.FACE_ASPECT_SD
    alike: float = 1.0
    scale: float = 1.0


@dataclass(frozen=True)
class _Seen:
    """One sign: ``grid`` [g] rad its normals; ``centres`` [c] rad the prior's and ``beside`` [c] by
    how much less a sign that far from such a road is for it than one at its side; ``measured`` [n]
    log aspects of its boxes, ``expected`` [n, g] those of the bare face; ``sd`` [n]; ``crowd``
    [n] how many of them are from one place each; ``columns``
    [n, 1 + k] of what its boxes share: the aspect, and what those of each octave of size err by in
    common, stated sigmas; ``least`` [n] log aspect below which no box is found; ``octave`` [n] of
    each box and ``octaves`` [k] of the columns; ``sure`` whether the face's shape is known;
    ``yaw_sd`` of the trajectory, rad."""

    grid: FloatArray
    centres: FloatArray
    beside: FloatArray
    measured: FloatArray
    expected: FloatArray
    sd: FloatArray
    crowd: FloatArray
    columns: FloatArray
    least: FloatArray
    octave: IntArray
    octaves: IntArray
    sure: bool
    yaw_sd: float


@dataclass(frozen=True)
class _Belief:
    """``normal`` [g] probability of each normal, ``core`` [c, g] the part of it that is about the
    road's direction; ``shared`` [1 + k] means and ``shared_variance`` [1 + k] of what the boxes
    share; ``residual`` [n] in sigmas at the likeliest normal, ``absorbed`` degrees of freedom that
    it took."""

    normal: FloatArray
    core: FloatArray
    shared: FloatArray
    shared_variance: FloatArray
    residual: FloatArray
    absorbed: float


def narrowest(views: Views) -> float:
    """Logarithm of the width, as a direction, below which a detector finds no box: from the two
    narrowest of its boxes (D. S. Robson, J. H. Whitlock, Biometrika 51, 1964)."""
    widths = views.measured[:, 2] + views.log_aspect
    least = np.sort(widths[np.isfinite(widths)])[:2]
    return float(2.0 * least[0] - least[1]) if len(least) == 2 else -np.inf


def find_facings(
    views: Views, groups: Sequence[Sequence[Sighting]], path: Path, least: float = -np.inf
) -> tuple[list[Facing], Faces]:
    """The way each sign faces, of its sightings (at least one each), and what all have in common;
    ``least`` log width of a box that is found, as ``narrowest`` tells of a detector's.

    Where a sign's boxes tell nothing it faces against the traffic, with the sigma of all.
    """
    telling = [
        sightings
        for sightings in groups
        if sum(int(np.isfinite(views.log_aspect[s.landmark.rows]).sum()) for s in sightings)
        >= limits.SCATTER_VIEWS
    ]
    some = telling[:: max(1, -(-len(telling) // limits.SCATTER_SIGNS))]
    faces = _common([_observed(views, sightings, path, least) for sightings in some])
    # what was expected of every box of a long drive would be gigabytes
    seen = (_observed(views, sightings, path, least) for sightings in groups)
    return [_summary(one, _believe(one, faces)) for one in seen], faces


def _observed(
    views: Views, sightings: Sequence[Sighting], path: Path, least: float = -np.inf
) -> _Seen:
    rows = np.concatenate([s.landmark.rows for s in sightings])
    sd = np.concatenate([view_sd(views, s.landmark.rows)[:, 2] for s in sightings])
    crowds = np.concatenate([crowd(views, s.landmark.rows) for s in sightings])
    weight = np.concatenate([s.landmark.weight for s in sightings])
    towards = np.sum([s.facing for s in sightings], axis=0)
    grid = np.arctan2(towards[1], towards[0]) + _GRID
    told = np.isfinite(views.log_aspect[rows])
    rows, sd, weight = rows[told], sd[told], weight[told]
    names = [str(name) for name in views.class_name[rows]]
    shape, sure = outline_of(commonest(names) if names else "")
    measured = views.log_aspect[rows]
    size = views.measured[rows, 2] + 0.5 * measured
    octave = np.clip(np.floor(size / np.log(2.0)), -_OCTAVES, -1).astype(np.int64) + _OCTAVES
    octaves = np.unique(octave)
    alike = np.hypot(views.margin_sd[rows] * np.exp(-size), limits.FACE_ALIKE)
    # a width has the scatter of a height, in pixels
    sd = sd * np.hypot(1.0, np.maximum(np.exp(-measured), 1.0)) / np.sqrt(np.maximum(weight, 1e-3))
    centres, beside = _against_traffic(views, sightings, path)
    return _Seen(
        grid=grid,
        centres=centres,
        beside=beside,
        measured=measured,
        expected=expected_aspect(views, rows, grid, shape),
        sd=sd,
        crowd=crowds[told],
        columns=np.column_stack(
            [np.ones(len(rows))] + [np.where(octave == one, alike, 0.0) for one in octaves]
        ),
        least=least - views.measured[rows, 2],
        octave=octave,
        octaves=octaves,
        sure=sure,
        yaw_sd=float(views.attitude_sd[rows, 2].mean()) if len(rows) else 0.0,
    )


def _against_traffic(
    views: Views, sightings: Sequence[Sighting], path: Path
) -> tuple[FloatArray, FloatArray]:
    """Directions [2 s] rad against the course, where the car passes the sign and where it saw it
    last: before a bend the two are different, and nothing says which road the sign is for but how
    far aside of each it stands. Signs for a road are about it normally, those for others as many
    per metre anywhere; the second value [2 s] is the mean of that over the place's own error."""
    centres, beside = [], []
    for sighting in sightings:
        seen = views.t_ns[sighting.landmark.rows]
        roads = roads_at(path, sighting.position, int(seen.min()), int(seen.max()))
        right = roads[:, 1:3]
        variance = np.einsum("ci,ij,cj->c", right, sighting.covariance[:2, :2], right)
        wide = variance + limits.BESIDE_SD_M**2
        centres.append(roads[:, 0] + np.pi)
        beside.append(limits.BESIDE_SD_M / np.sqrt(wide) * np.exp(-0.5 * roads[:, 3] ** 2 / wide))
    return np.concatenate(centres), np.concatenate(beside)


def expected_aspect(views: Views, rows: IntArray, normal: FloatArray, shape: str) -> FloatArray:
    """Logarithm [n, g] of width over height of the box about a small upright face of a shape, seen
    in the views ``rows`` [n], of each ``normal`` [g] rad in the local frame.

    First order in the size over the distance: a point ``p`` of the face off its centre by
    ``d`` in camera axes moves the picture by (d_right - y d_forward, d_down - z d_forward).
    """
    corners = outline_points(shape, _CIRCLE_POINTS) - 0.5
    across = np.column_stack([np.sin(normal), -np.cos(normal), np.zeros(len(normal))])
    along = np.einsum("nij,gj->ngi", views.C_cam_ref[rows], across)
    down = views.C_cam_ref[rows][:, :, 2][:, None, :]
    where = views.measured[rows, :2][:, None, :]
    by_x, by_y = (v[..., 1:] - where * v[..., :1] for v in (along, down))
    extent = []
    for axis in (0, 1):
        points = by_x[..., axis, None] * corners[:, 0] + by_y[..., axis, None] * corners[:, 1]
        extent.append(points.max(axis=-1) - points.min(axis=-1))
    return np.asarray(np.log(np.maximum(extent[0], limits.THINNEST * extent[1]) / extent[1]))


def _believe(one: _Seen, faces: Faces) -> _Belief:
    """Bayes' rule on the grid, aspect and margins eliminated (Schur complement); boxes that fit the
    likeliest normal ill count less (Cauchy). Of a face so turned that only its widest boxes are
    found, those that were are as wide as that: each counts by how likely it is among the found."""
    aspect_sd = np.hypot(faces.aspect_sd, 0.0 if one.sure else limits.PLATE_ASPECT_SD)
    prior = np.full(one.columns.shape[1], faces.alike) ** -2.0
    prior[0] = aspect_sd**-2.0
    off = one.measured[:, None] - one.expected - faces.log_aspect[one.octave, None]
    core, elsewhere = _prior(one, faces)
    sd, weight = one.sd * faces.scale, np.ones(len(one.sd))
    for _ in range(3):
        scaled = one.columns * (weight / sd**2)[:, None]
        inverse = np.linalg.inv(scaled.T @ one.columns + np.diag(prior))
        shared = inverse @ (scaled.T @ off)
        square = (weight / sd**2) @ off**2 - np.einsum("kg,kg->g", scaled.T @ off, shared)
        wider = one.measured[:, None] - off + one.columns @ shared - one.least[:, None]
        found = np.maximum(ndtr(wider / sd[:, None]), limits.FOUND_ANYWAY)
        square += 2.0 * weight @ np.log(found)
        likely = np.exp(-0.5 * (square - square.min()))
        total = float(((core.sum(axis=0) + elsewhere) * likely).sum())
        normal = (core.sum(axis=0) + elsewhere) * likely / total
        best = int(np.argmax(normal))
        residual = (off[:, best] - one.columns @ shared[:, best]) / sd
        weight = cauchy_weight(residual**2)
    mean = shared @ normal
    return _Belief(
        normal=normal,
        core=core * likely / total,
        shared=mean,
        shared_variance=np.diag(inverse) + (shared - mean[:, None]) ** 2 @ normal,
        residual=residual,
        absorbed=1.0 + float(np.sum(1.0 - np.diag(inverse) * prior)),
    )


def _prior(one: _Seen, faces: Faces) -> tuple[FloatArray, FloatArray]:
    """What is believed before any width: [c, g] about the road's directions, [g] elsewhere."""
    turn = wrap_pi(one.grid - one.centres[:, None])
    core = np.exp(-0.5 * (turn / faces.turned_sd) ** 2)
    step = float(_GRID[1] - _GRID[0])
    core *= (1.0 - faces.elsewhere) * step / (np.sqrt(2.0 * np.pi) * faces.turned_sd)
    core *= one.beside[:, None]
    elsewhere = np.full(len(one.grid), faces.elsewhere / len(one.grid))
    return core / len(one.centres), elsewhere


def _common(seen: Sequence[_Seen]) -> Faces:
    """What the signs of the drive say of all."""
    faces, freedom = Faces(), limits.FACES_FREEDOM
    # what stands far aside tells nothing of how many beside the road are for another
    beside = np.array([one.beside.max() for one in seen])
    for _ in range(_ROUNDS):
        believed = [_believe(one, faces) for one in seen]
        if not believed:
            break
        absorbed = float(np.mean([b.absorbed for b in believed]))
        scale = faces.scale * scatter(
            [b.residual for b in believed], [one.crowd for one in seen], absorbed
        )
        share = np.array([b.core.sum() for b in believed])
        square = sum(
            float((b.core * wrap_pi(one.grid - one.centres[:, None]) ** 2).sum())
            for one, b in zip(seen, believed, strict=True)
        )
        told = [(one, b) for one, b in zip(seen, believed, strict=True) if one.sure]
        off, number = np.zeros(_OCTAVES), np.zeros(_OCTAVES)
        for one, b in told:
            for column, octave in enumerate(one.octaves.tolist(), start=1):
                here = one.columns[one.octave == octave, column].mean()
                off[octave] += faces.log_aspect[octave] + b.shared[0] + here * b.shared[column]
                number[octave] += 1.0
        spread = sum(float(b.shared[0] ** 2 + b.shared_variance[0]) for _, b in told)
        common = np.concatenate([b.shared[1:] ** 2 + b.shared_variance[1:] for b in believed])
        faces = replace(
            faces,
            turned_sd=float(
                np.sqrt((freedom * limits.TURNED_SD**2 + square) / (freedom + share.sum()))
            ),
            elsewhere=float(
                (freedom * limits.FACE_ELSEWHERE + beside @ (1.0 - share))
                / (freedom + beside.sum())
            ),
            log_aspect=off / (freedom + number),
            aspect_sd=float(
                np.sqrt((freedom * limits.FACE_ASPECT_SD**2 + spread) / (freedom + len(told)))
            ),
            alike=float(np.sqrt((freedom + common.sum()) / (freedom + len(common)))),
            scale=float(np.clip(scale, *limits.SCATTER_LIMITS)),
        )
    # no less than stated: few signs do not tell how far a detector's boxes err alike
    return replace(faces, alike=max(1.0, faces.alike))


def _summary(one: _Seen, belief: _Belief) -> Facing:
    """The median of a belief, which is in the likelier of two modes and near the mean of one, and
    the root mean square about it; no less than what 95 % of the belief lies within tells."""
    middle = float(np.interp(0.5, np.cumsum(belief.normal) - 0.5 * belief.normal, one.grid))
    off = np.abs(one.grid - middle)
    order = np.argsort(off)
    within = np.cumsum(belief.normal[order])
    most = float(off[order][np.searchsorted(within, 1.0 - _OUTSIDE)]) / sigmas(_OUTSIDE)
    sd = max(float(np.sqrt(belief.normal @ off**2)), most)
    return Facing(middle % (2.0 * np.pi), float(np.hypot(sd, one.yaw_sd)))
