"""All that is kept of a drive's run, and its comparison with a later run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from automap.records import Trajectory
from automap.regression import epochs, scalars, signs
from automap.regression.change import Change, Tolerance
from automap.regression.epochs import Epochs
from automap.regression.limits import LEAST_UNITS
from automap.regression.scalars import Figures
from automap.regression.signs import StoredSign


@dataclass(frozen=True)
class DriveRecord:
    """The figures of a run.

    ``path_en_m`` [n][2] is the simplified path for drawing, metres east and north of the first
    epoch; ``timing`` processor time of each stage over that of the reference computation;
    ``truth`` errors against the truth where the drive has one; ``inputs`` short digests of the
    input files and ``settings`` those that differ from the defaults.
    """

    epochs: Epochs
    path_en_m: list[list[float]]
    signs: list[StoredSign]
    sync: Figures
    calibration: Figures
    counts: dict[str, int]
    timing: dict[str, float]
    truth: dict[str, float] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)


def compare(
    then: DriveRecord, now: DriveRecord, trajectory: Trajectory | None, allowed: Tolerance
) -> list[Change]:
    """Every figure then and now, ``trajectory`` being the one of the run ``now``."""
    return [
        *_provenance(then, now),
        *scalars.compare_counts(then.counts, now.counts, allowed),
        *epochs.compare(then.epochs, trajectory, allowed),
        *signs.compare(then.signs, now.signs, allowed),
        *scalars.compare(then.sync, now.sync, "sync", allowed),
        *scalars.compare(then.calibration, now.calibration, "calibration", allowed),
        *compare_timing(then.timing, now.timing, allowed),
        *_truth(then.truth, now.truth),
    ]


def slower_stages(
    then: Mapping[str, float], now: Mapping[str, float], allowed: Tolerance
) -> list[str]:
    """Stages that took longer than is allowed."""
    return [
        name
        for name, ratio in now.items()
        if name in then and ratio > then[name] * allowed.slower and ratio - then[name] > LEAST_UNITS
    ]


def compare_timing(
    then: Mapping[str, float], now: Mapping[str, float], allowed: Tolerance
) -> list[Change]:
    """Stages by processor time in units of the reference computation.

    A stage must be slower by the factor and by LEAST_UNITS; faster is only told.
    """
    slow = slower_stages(then, now, allowed)
    return [
        Change(
            "timing",
            name,
            f"{then[name]:.2f} units",
            f"{now[name]:.2f} units",
            moved=name in slow,
            size=f"x {now[name] / then[name]:.2f}" if then[name] > 0.0 else "",
            information=now[name] < then[name],
        )
        for name in then
        if name in now
    ]


def _provenance(then: DriveRecord, now: DriveRecord) -> list[Change]:
    """Inputs and settings that are no longer the ones of the stored run; told, not judged."""
    changes = []
    for kind, old, new in (
        ("input", then.inputs, now.inputs),
        ("setting", then.settings, now.settings),
    ):
        for name in sorted({*old, *new}):
            if old.get(name) != new.get(name):
                changes.append(
                    Change(
                        "run",
                        f"{kind} {name}",
                        str(old.get(name, "none")),
                        str(new.get(name, "none")),
                        moved=False,
                        size="changed",
                        information=True,
                    )
                )
    return changes


def _truth(then: Mapping[str, float], now: Mapping[str, float]) -> list[Change]:
    """Errors against the truth: which way a move went; told, not judged."""
    changes = []
    for name in then:
        if name in now:
            better = now[name] - then[name]
            changes.append(
                Change(
                    "truth",
                    name,
                    f"{then[name]:.3f}",
                    f"{now[name]:.3f}",
                    moved=False,
                    size=f"{better:+.3f}" if abs(better) >= 5e-4 else "",
                    information=True,
                )
            )
    return changes


def to_json(record: DriveRecord) -> dict[str, Any]:
    """The record in JSON's types, a few kB."""
    return {
        "counts": record.counts,
        "sync": scalars.to_json(record.sync),
        "calibration": scalars.to_json(record.calibration),
        "timing": {name: float(f"{ratio:.4g}") for name, ratio in record.timing.items()},
        "truth": {name: float(f"{value:.5g}") for name, value in record.truth.items()},
        "inputs": record.inputs,
        "settings": record.settings,
        "signs": signs.to_json(record.signs),
        "trajectory": epochs.to_json(record.epochs),
        "path_en_m": record.path_en_m,
    }


def from_json(stored: Mapping[str, Any]) -> DriveRecord:
    """What ``to_json`` wrote; raises KeyError, TypeError or ValueError for anything else."""
    return DriveRecord(
        epochs=epochs.from_json(stored["trajectory"]),
        path_en_m=[[float(e), float(n)] for e, n in stored["path_en_m"]],
        signs=signs.from_json(stored["signs"]),
        sync=scalars.from_json(stored["sync"]),
        calibration=scalars.from_json(stored["calibration"]),
        counts={str(k): int(v) for k, v in stored["counts"].items()},
        timing={str(k): float(v) for k, v in stored["timing"].items()},
        truth={str(k): float(v) for k, v in stored["truth"].items()},
        inputs={str(k): str(v) for k, v in stored["inputs"].items()},
        settings=dict(stored["settings"]),
    )
