"""A map of signs then and now: which came, which went, how far the others moved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.evaluation.sign_matching import match
from automap.records import FloatArray, Sign, SignPoints
from automap.regression.change import Change, Tolerance
from automap.regression.limits import SAME_SIGN_M, SIGN_FLOOR_M

_NAMED = 3
"""So many signs are named where more have come or gone."""


@dataclass(frozen=True)
class StoredSign:
    """What is kept of a sign: place (rad, m), covariance east-north [2, 2] and up, class,
    confidence."""

    id: str
    class_name: str
    lat_rad: float
    lon_rad: float
    height_m: float
    cov_en: FloatArray
    sd_u_m: float
    confidence: float


def reduce_signs(signs: Sequence[Sign]) -> list[StoredSign]:
    """What is kept of each sign, in the order of the map."""
    return [
        StoredSign(
            id=sign.id,
            class_name=sign.class_name,
            lat_rad=sign.lat_rad,
            lon_rad=sign.lon_rad,
            height_m=sign.height_m,
            cov_en=np.asarray(sign.cov_enu[:2, :2], np.float64),
            sd_u_m=float(np.sqrt(sign.cov_enu[2, 2])),
            confidence=sign.confidence,
        )
        for sign in signs
    ]


def compare(
    then: Sequence[StoredSign], now: Sequence[StoredSign], allowed: Tolerance
) -> list[Change]:
    """What has become of the map; signs are matched one to one by place alone."""
    if not then and not now:
        return []
    pairs = match(_points(now), _points(then), SAME_SIGN_M)
    matched_now, matched_then = set(pairs.estimate.tolist()), set(pairs.truth.tolist())
    gone = [sign for i, sign in enumerate(then) if i not in matched_then]
    come = [sign for i, sign in enumerate(now) if i not in matched_now]
    changes = [
        _came_or_went("signs gone", gone, allowed),
        _came_or_went("signs new", come, allowed),
    ]
    both = [(then[j], now[i]) for i, j in zip(pairs.estimate, pairs.truth, strict=True)]
    if both:
        changes += _positions(both, allowed)
        changes += _judgements(both, allowed)
    return [
        Change("signs", "number", str(len(then)), str(len(now)), moved=False, information=True),
        *changes,
    ]


def _came_or_went(name: str, signs: Sequence[StoredSign], allowed: Tolerance) -> Change:
    sure = [sign for sign in signs if sign.confidence >= allowed.sure]
    doubtful = len(signs) - len(sure)
    words = ", ".join(f"{sign.id} {sign.class_name}" for sign in sure[:_NAMED])
    if len(sure) > _NAMED:
        words += f" and {len(sure) - _NAMED} more"
    if doubtful:
        words += f"{' and ' if words else ''}{doubtful} doubtful"
    return Change("signs", name, "0", str(len(signs)), moved=bool(sure), size=words)


def _positions(both: Sequence[tuple[StoredSign, StoredSign]], allowed: Tolerance) -> list[Change]:
    distance, horizontal, vertical = _moves(both)
    changes = [
        _place("position", horizontal, distance, both, allowed),
        _place(
            "height",
            vertical,
            np.array([abs(b.height_m - a.height_m) for a, b in both]),
            both,
            allowed,
        ),
    ]
    spread = [
        _area(b.cov_en) / _area(a.cov_en)
        for a, b in both
        if _area(a.cov_en) > 0.0 and _area(b.cov_en) > 0.0
    ]
    if spread:
        factor = float(np.exp(np.median(np.log(spread))))
        changes.append(
            Change(
                "signs",
                "stated sigma of position",
                f"{float(np.median([_area(a.cov_en) for a, _ in both])):.3g} m",
                f"{float(np.median([_area(b.cov_en) for _, b in both])):.3g} m",
                moved=max(factor, 1.0 / factor) > allowed.spread,
                size=f"x {factor:.2f}" if round(factor, 2) != 1.0 else "",
            )
        )
    return changes


def _moves(
    both: Sequence[tuple[StoredSign, StoredSign]],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Metres, sigmas per axis and vertical sigmas [n] by which the pairs moved."""
    import pymap3d

    distance, sigmas, vertical = (np.zeros(len(both)) for _ in range(3))
    for i, (a, b) in enumerate(both):
        east, north, _ = pymap3d.geodetic2enu(
            b.lat_rad, b.lon_rad, 0.0, a.lat_rad, a.lon_rad, 0.0, deg=False
        )
        move = np.array([east, north], np.float64)
        distance[i] = float(np.hypot(east, north))
        covariance = a.cov_en + SIGN_FLOOR_M**2 * np.eye(2)
        if np.isfinite(covariance).all():
            sigmas[i] = float(np.sqrt(move @ np.linalg.solve(covariance, move) / 2.0))
        else:
            sigmas[i] = distance[i]
        scale = max(a.sd_u_m, SIGN_FLOOR_M) if np.isfinite(a.sd_u_m) else 1.0
        known = np.isfinite(a.height_m) and np.isfinite(b.height_m)
        vertical[i] = abs(b.height_m - a.height_m) / scale if known else 0.0
    return distance, sigmas, vertical


def _place(
    name: str,
    sigmas: FloatArray,
    metres: FloatArray,
    both: Sequence[tuple[StoredSign, StoredSign]],
    allowed: Tolerance,
) -> Change:
    rms, worst = float(np.sqrt(np.mean(sigmas**2))), int(np.argmax(sigmas))
    if rms <= allowed.mean and sigmas[worst] > allowed.worst:
        return Change(
            "signs",
            f"{name}, worst sign",
            both[worst][0].id,
            f"{metres[worst]:.3g} m off",
            moved=True,
            sigmas=float(sigmas[worst]),
            allowed=allowed.worst,
        )
    return Change(
        "signs",
        f"{name} of {len(both)} signs",
        "",
        f"{float(np.sqrt(np.nanmean(metres**2))):.3g} m off",
        moved=rms > allowed.mean,
        sigmas=rms,
        allowed=allowed.mean,
    )


def _judgements(both: Sequence[tuple[StoredSign, StoredSign]], allowed: Tolerance) -> list[Change]:
    renamed = [(a, b) for a, b in both if a.class_name != b.class_name]
    counts = Counter(f"{a.class_name} to {b.class_name}" for a, b in renamed)
    words = ", ".join(text for text, _ in counts.most_common(_NAMED))
    step = max(abs(b.confidence - a.confidence) for a, b in both)
    mean_then = float(np.mean([a.confidence for a, _ in both]))
    mean_now = float(np.mean([b.confidence for _, b in both]))
    return [
        Change("signs", "classes changed", "0", str(len(renamed)), moved=bool(renamed), size=words),
        Change(
            "signs",
            "mean confidence",
            f"{mean_then:.2f}",
            f"{mean_now:.2f}",
            moved=step > allowed.confidence,
            size=f"by {step:.2f} at most" if step >= 0.005 else "",
        ),
    ]


def _area(covariance: FloatArray) -> float:
    """Sigma per axis of the circle as large as the error ellipse, m."""
    determinant = float(covariance[0, 0] * covariance[1, 1] - covariance[0, 1] ** 2)
    return determinant**0.25 if determinant > 0.0 else 0.0


def _points(signs: Sequence[StoredSign]) -> SignPoints:
    return SignPoints(
        lat_rad=np.array([s.lat_rad for s in signs], np.float64),
        lon_rad=np.array([s.lon_rad for s in signs], np.float64),
        class_name=np.array([s.class_name for s in signs], np.object_),
        cov_en=np.array([s.cov_en for s in signs], np.float64).reshape(-1, 2, 2),
        sd_m=np.zeros(len(signs)),
    )


def to_json(signs: Sequence[StoredSign]) -> list[list[Any]]:
    """One short row for each sign: id, class, degrees, height, covariance, confidence."""
    return [
        [
            s.id,
            s.class_name,
            round(float(np.degrees(s.lat_rad)), 9),
            round(float(np.degrees(s.lon_rad)), 9),
            _short(s.height_m, 3),
            *(_figures(v) for v in (s.cov_en[0, 0], s.cov_en[0, 1], s.cov_en[1, 1], s.sd_u_m)),
            _short(s.confidence, 3),
        ]
        for s in signs
    ]


def from_json(rows: Sequence[Sequence[Any]]) -> list[StoredSign]:
    """What ``to_json`` wrote; raises TypeError or ValueError for anything else."""
    signs = []
    for identity, class_name, lat, lon, height, ee, en, nn, sd_u, confidence in rows:
        ee, en, nn = (_number(v) for v in (ee, en, nn))
        signs.append(
            StoredSign(
                id=str(identity),
                class_name=str(class_name),
                lat_rad=float(np.radians(lat)),
                lon_rad=float(np.radians(lon)),
                height_m=_number(height),
                cov_en=np.array([[ee, en], [en, nn]]),
                sd_u_m=_number(sd_u),
                confidence=_number(confidence),
            )
        )
    return signs


def _short(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None


def _figures(value: float) -> float | None:
    return float(f"{value:.5g}") if np.isfinite(value) else None


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)
