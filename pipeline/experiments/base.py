"""What the experiments share: a prepared drive, cut fixes, comparison, figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.earth import local_ned
from automap.errors import InputError
from automap.fusion.options import FusionOptions
from automap.io.atomic import atomic_path, make_folder, write_json
from automap.records import Fixes, FloatArray, Trajectory
from pipeline.pages.palette import ON_LIGHT
from pipeline.run.fusion_inputs import FusionInputs
from pipeline.settings.load import Settings
from pipeline.settings.presets import fusion_options

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OWN_GAP_S = 2.0
"""A recording without a fix for longer is marked."""


@dataclass(frozen=True)
class Experiment:
    """A drive that went through ingest and sync, how to fuse it, and where the results go."""

    inputs: FusionInputs
    options: FusionOptions
    out: Path

    def save(self, name: str, figure: Figure, figures: dict[str, Any]) -> None:
        """Write NAME.png and NAME.json."""
        save(self.out, name, figure, figures)


def save(out: Path, name: str, figure: Figure, figures: dict[str, Any]) -> None:
    """Write NAME.png and NAME.json into a folder."""
    with atomic_path(out / f"{name}.png") as path:
        figure.savefig(path, format="png", dpi=120)
    write_json(out / f"{name}.json", figures)


def prepare(drive_path: Path, out: Path, settings: Settings) -> Experiment:
    """Run ingest and sync of a drive into OUT/run.

    Raises:
        InputError: the drive has no IMU or no fixes.
    """
    from automap.io.drive import load_drive
    from pipeline.run.prepared import prepared

    inputs = prepared(drive_path, make_folder(out) / "run", settings)
    options, _ = fusion_options(load_drive(drive_path), settings.fuse)
    return Experiment(inputs, options, out)


def outage_windows(
    fixes: Fixes, off_s: float, every_s: float, start_s: float
) -> list[tuple[float, float]]:
    """GPS intervals of ``off_s`` in every ``every_s``, the first ``start_s`` after the start.

    InputError when the fixes do not last long enough for one.
    """
    usable = fixes.gps_s[np.isfinite(fixes.gps_s) & (fixes.fix_type > 0)]
    begin, end = float(usable.min(initial=np.inf)), float(usable.max(initial=-np.inf))
    last = end - off_s - 5.0
    starts = np.arange(begin + start_s, last, every_s) if begin < last else np.zeros(0)
    if not len(starts):
        raise InputError(
            f"the fixes last {max(end - begin, 0.0):.0f} s, too short for an outage of {off_s:g} s "
            f"{start_s:g} s after their start; choose a smaller --outage and --every."
        )
    return [(float(s), float(s) + off_s) for s in starts]


def without(fixes: Fixes, windows: Sequence[tuple[float, float]]) -> Fixes:
    """The fixes outside the windows."""
    keep = np.ones(len(fixes), dtype=bool)
    for start, stop in windows:
        keep &= ~((fixes.gps_s >= start) & (fixes.gps_s < stop))
    return replace(fixes, **{f.name: getattr(fixes, f.name)[keep] for f in fields(fixes)})


def horizontal_distance(a: Trajectory, b: Trajectory) -> FloatArray:
    """Horizontal distance [n] in m of two trajectories with the same epochs."""
    ref = (float(a.lat_rad[0]), float(a.lon_rad[0]), float(a.height_m[0]))
    difference = plane(a, ref) - plane(b, ref)
    return np.asarray(np.hypot(difference[:, 0], difference[:, 1]))


def plane(trajectory: Trajectory, ref: tuple[float, float, float]) -> FloatArray:
    """Positions [n, 3] in metres NED of a reference."""
    return local_ned(trajectory.lat_rad, trajectory.lon_rad, trajectory.height_m, ref)


def largest_in(
    distance: FloatArray, gps_s: FloatArray, windows: Sequence[tuple[float, float]]
) -> FloatArray:
    """Largest distance [w] within each window."""
    return np.array(
        [float(distance[(gps_s >= a) & (gps_s < b)].max(initial=0.0)) for a, b in windows]
    )


def rms(values: FloatArray) -> float:
    """Root mean square, 0 of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def new_figure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Any]:
    """A matplotlib figure off screen in the colours of the pages, with its axes."""
    import matplotlib as mpl
    from matplotlib.rcsetup import cycler

    mpl.use("Agg")
    mpl.rcParams["axes.prop_cycle"] = cycler(color=ON_LIGHT)
    from matplotlib import pyplot

    return pyplot.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")


def shade_outages(
    plot: Any, cut: Fixes, windows: Sequence[tuple[float, float]], begin: float
) -> None:
    """Grey where GPS was cut off, hatched where the recording itself has none; ``cut`` are the
    fixes that were left, ``begin`` the GPS time at which the plot's axis begins."""
    for start, stop in windows:
        plot.axvspan(start - begin, stop - begin, color="0.9")
    usable = np.sort(cut.gps_s[np.isfinite(cut.gps_s) & (cut.fix_type > 0)])
    for row in np.flatnonzero(np.diff(usable) > OWN_GAP_S):
        start, stop = float(usable[row]), float(usable[row + 1])
        inside = sum(max(0.0, min(stop, b) - max(start, a)) for a, b in windows)
        if stop - start - inside > OWN_GAP_S:
            plot.axvspan(
                start - begin, stop - begin, facecolor="none", edgecolor="0.8", hatch="//", lw=0
            )
