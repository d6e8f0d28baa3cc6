"""By what the map can colour the path: sigma, satellites, time without a fix, speed."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.export.path import Path
from automap.export.uncertainty import sigma_classes
from automap.records import Fixes, FixType, FloatArray, IntArray
from pipeline.shared.products import RunProducts

_SATELLITES = (5, 8, 12)
_SILENCE_S = (1.5, 5.0, 15.0)
_SPEED_KMH = (10.0, 30.0, 60.0, 90.0)


@dataclass(frozen=True)
class Mode:
    """One way of colouring: the class [n] of every point (-1 unknown) and the classes' labels,
    from the best to the worst, of speeds from the lowest to the highest."""

    key: str
    title: str
    classes: IntArray
    labels: list[str]

    def as_json(self) -> dict[str, Any]:
        """With the classes as runs of [class, number of points]."""
        edges = np.flatnonzero(np.diff(self.classes)) + 1
        parts = np.split(self.classes, edges)
        return {
            "key": self.key,
            "title": self.title,
            "labels": self.labels,
            "runs": [[int(part[0]), len(part)] for part in parts if len(part)],
        }


def path_modes(products: RunProducts, path: Path) -> list[Mode]:
    """The ways in which this path can be coloured; those without any data are left out."""
    classes, labels = sigma_classes(path.sd_h_m)
    modes = [Mode("sigma", "horizontal σ", classes, labels)] if labels else []
    fixes = products.fixes
    if fixes is not None and products.trajectory is not None:
        gps_s = products.trajectory.gps_s[path.row]
        modes += _of_fixes(fixes, gps_s)
    if np.isfinite(path.speed_m_s).any():
        speed = _classes(path.speed_m_s * 3.6, _SPEED_KMH)
        modes.append(Mode("speed", "speed", speed, _labels(_SPEED_KMH, " km/h")))
    return modes


def _of_fixes(fixes: Fixes, gps_s: FloatArray) -> list[Mode]:
    good = np.isfinite(fixes.gps_s) & (fixes.fix_type != int(FixType.NONE))
    good &= np.isfinite(fixes.lat_rad)
    if not good.any():
        return []
    order = np.argsort(fixes.gps_s[good], kind="stable")
    times = fixes.gps_s[good][order]
    satellites = fixes.n_sats[good][order]
    after = np.searchsorted(times, gps_s).clip(max=len(times) - 1)
    before = (after - 1).clip(min=0)
    nearer = np.abs(times[before] - gps_s) <= np.abs(times[after] - gps_s)
    nearest = np.where(nearer, before, after)
    distance = np.abs(times[nearest] - gps_s)
    silence = np.where(np.isfinite(gps_s), _classes(distance, _SILENCE_S), -1)
    modes = []
    if (satellites >= 0).any():
        seen = satellites[nearest].astype(np.float64)
        seen[(satellites[nearest] < 0) | ~(distance < _SILENCE_S[-1])] = np.nan
        # the most satellites are the best
        classes = _classes(seen, _SATELLITES)
        classes = np.where(classes >= 0, len(_SATELLITES) - classes, -1)
        labels = ["12 or more", "8 to 11", "5 to 7", "fewer than 5"]
        modes.append(Mode("satellites", "satellites", classes, labels))
    modes.append(Mode("outage", "time from a GPS fix", silence, _labels(_SILENCE_S, " s")))
    return modes


def _classes(values: FloatArray, limits: tuple[float, ...]) -> IntArray:
    classes = np.searchsorted(limits, values, "right").astype(np.int64)
    return np.where(np.isfinite(values), classes, -1)


def _labels(limits: tuple[float, ...], unit: str) -> list[str]:
    inner = [f"{a:g} to {b:g}{unit}" for a, b in itertools.pairwise(limits)]
    return [f"below {limits[0]:g}{unit}", *inner, f"above {limits[-1]:g}{unit}"]
