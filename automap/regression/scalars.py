"""Single figures of a run with their sigmas: clock, delays, sensor errors, mounting, counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from automap.effects import CATALOGUE
from automap.regression.change import Change, Group, Tolerance
from automap.regression.limits import ROUNDING

_ANGLES = ("roll", "pitch", "yaw")

Figures = dict[str, tuple[float, float]]
"""Value and one sigma by name."""


def from_metrics(metrics: Mapping[str, Any]) -> Figures:
    """Every figure of run.json's metrics that states its sigma.

    ``imu_delay_s`` belongs to ``imu_delay_sd_s``, ``mounting_rpy_deg`` to
    ``mounting_rpy_sd_deg``: the sigma's name is the figure's with ``_sd`` put in.
    """
    flat = dict(_flatten(metrics))
    figures: Figures = {}
    for key, sd in flat.items():
        name = key.replace("_sd", "", 1)
        if "_sd" not in key or name not in flat:
            continue
        value = flat[name]
        if math.isfinite(value) and math.isfinite(sd):
            figures[name] = (value, sd)
    return figures


def _flatten(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, float]]:
    """Numbers by dotted name; those of a list are numbered, three angles named."""
    found: list[tuple[str, float]] = []
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            found += _flatten(value, f"{name}.")
        elif isinstance(value, list):
            angles = "rpy" in key and len(value) == 3
            labels = _ANGLES if angles else [str(i) for i in range(len(value))]
            found += _flatten(dict(zip(labels, value, strict=True)), f"{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append((name, float(value)))
    return found


def from_errors(columns: Mapping[str, Any]) -> Figures:
    """The sensor errors at the end of the drive from the columns of ``imu_errors.parquet``.

    The wandering error of the receiver is left out: it is a state of the moment, not a figure
    of the installation.
    """
    figures: Figures = {}
    of_the_moment = tuple(f"{e.name}_" for e in CATALOGUE.values() if e.markov is not None)
    for name, values in columns.items():
        sd = columns.get(f"sd_{name}")
        if sd is None or len(values) == 0 or name.startswith(of_the_moment):
            continue
        value, sigma = float(values[-1]), float(sd[-1])
        if math.isfinite(value) and math.isfinite(sigma):
            figures[name] = (value, sigma)
    return figures


def compare(then: Figures, now: Figures, group: Group, allowed: Tolerance) -> list[Change]:
    """How far each figure moved, in its own sigmas; one that came or went has moved."""
    changes = []
    for name in [*then, *(key for key in now if key not in then)]:
        if name not in now or name not in then:
            shown = _shown(*(then.get(name) or now[name]))
            pair = (shown, "none") if name in then else ("none", shown)
            changes.append(Change(group, name, *pair, moved=True))
            continue
        (old, old_sd), (new, new_sd) = then[name], now[name]
        floor = ROUNDING * float(np.spacing(max(abs(old), abs(new), 1e-300)))
        step = abs(math.remainder(new - old, 360.0) if "_deg" in name else new - old)
        sigmas = 0.0 if step <= floor else step / max(old_sd, floor)
        changes.append(
            Change(
                group,
                name,
                _shown(old, old_sd),
                _shown(new, new_sd),
                moved=sigmas > allowed.mean,
                sigmas=sigmas,
                allowed=allowed.mean,
            )
        )
        factor = new_sd / old_sd if old_sd > 0.0 and new_sd > 0.0 else 1.0
        if max(factor, 1.0 / factor) > allowed.spread:
            changes.append(
                Change(
                    group,
                    f"stated sigma of {name}",
                    f"{old_sd:.3g}",
                    f"{new_sd:.3g}",
                    moved=True,
                    size=f"x {factor:.2f}",
                )
            )
    return changes


def compare_counts(
    then: Mapping[str, int], now: Mapping[str, int], allowed: Tolerance
) -> list[Change]:
    """Numbers of fixes, detections and the like, in standard deviations of a Poisson count."""
    changes = []
    for name in then:
        old, new = then[name], now.get(name, 0)
        sigmas = abs(new - old) / math.sqrt(max(old, 1))
        changes.append(
            Change(
                "run",
                name,
                str(old),
                str(new),
                moved=sigmas > allowed.count,
                sigmas=sigmas,
                allowed=allowed.count,
            )
        )
    return changes


def _shown(value: float, sd: float) -> str:
    """Value and sigma, the value to a hundredth of the sigma."""
    if sd > 0.0 and abs(value) < 1e14 * sd:
        digits = max(0, 1 - math.floor(math.log10(sd)))
        if digits <= 6:
            return f"{value:.{digits}f} ± {sd:.2g}"
    return f"{value:.4g} ± {sd:.2g}"


def to_json(figures: Figures) -> dict[str, list[float]]:
    """Pairs of value, to a thousandth of its sigma, and sigma to four figures."""
    return {
        name: [_rounded(value, sd), float(f"{sd:.4g}")] for name, (value, sd) in figures.items()
    }


def _rounded(value: float, sd: float) -> float:
    if not 0.0 < sd < math.inf:
        return value
    return round(value, 3 - math.floor(math.log10(sd)))


def from_json(stored: Mapping[str, Any]) -> Figures:
    """What ``to_json`` wrote; raises TypeError or ValueError for anything else."""
    return {str(name): (float(value), float(sd)) for name, (value, sd) in stored.items()}
