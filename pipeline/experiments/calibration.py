"""The paper's Fig. 4: the trajectory with a calibrated and an uncalibrated IMU.

GPS is cut off again and again; with the sensor's errors estimated the vehicle is carried
through, without them it drifts away. The reference is the smoothed run with all fixes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from automap.effects import CATALOGUE
from automap.fusion.options import DEFAULT_EFFECTS
from pipeline.experiments.base import (
    Experiment,
    horizontal_distance,
    largest_in,
    new_figure,
    outage_windows,
    plane,
    rms,
    shade_outages,
    without,
)

IMU_ERRORS = tuple(e for e in DEFAULT_EFFECTS if CATALOGUE[e].family == "imu")


def run(experiment: Experiment, off_s: float, every_s: float) -> dict[str, Any]:
    """Fuse with and without estimated IMU errors through outages; plot and compare."""
    inputs, options = experiment.inputs, experiment.options
    windows = outage_windows(inputs.fixes, off_s, every_s, every_s - off_s)
    cut = without(inputs.fixes, windows)
    reference = inputs.fuse(options).trajectory
    zero: dict[str, dict[str, float]] = {effect: {} for effect in IMU_ERRORS}
    uncalibrated = replace(
        options,
        effects=tuple(e for e in options.effects if e not in IMU_ERRORS),
        fixed={**options.fixed, **zero},
        adapt=False,
    )
    runs = {
        "calibrated": inputs.fuse(options, cut).filtered,
        "uncalibrated": inputs.fuse(uncalibrated, cut).filtered,
    }
    ref = (
        float(reference.lat_rad[0]),
        float(reference.lon_rad[0]),
        float(reference.height_m[0]),
    )
    figure, axes = new_figure(1, 2, (11, 5))
    path = plane(reference, ref)
    axes[0, 0].plot(path[:, 1], path[:, 0], "k", lw=2, label="all fixes, smoothed")
    result: dict[str, Any] = {"outage_s": off_s, "outages": len(windows)}
    t = reference.gps_s - reference.gps_s[0]
    for (name, trajectory), colour in zip(runs.items(), ("C0", "C3"), strict=True):
        distance = horizontal_distance(trajectory, reference)
        worst = largest_in(distance, trajectory.gps_s, windows)
        result[f"{name}_rms_of_largest_m"] = rms(worst)
        track = plane(trajectory, ref)
        axes[0, 0].plot(track[:, 1], track[:, 0], colour, lw=1, label=name)
        axes[0, 1].plot(t, distance, colour, lw=1, label=name)
    shade_outages(axes[0, 1], cut, windows, float(reference.gps_s[0]))
    low, high = path[:, :2].min(axis=0), path[:, :2].max(axis=0)
    (north, east), reach = 0.5 * (low + high), 0.6 * float((high - low).max()) + 10.0
    axes[0, 0].set(
        xlabel="east, m",
        ylabel="north, m",
        aspect="equal",
        xlim=(east - reach, east + reach),
        ylim=(north - reach, north + reach),
        title="forward filter through GPS outages",
    )
    axes[0, 1].set(
        xlabel="time, s",
        ylabel="horizontal distance to the reference, m",
        title=f"outages of {off_s:.0f} s (grey; hatched: none recorded)",
        yscale="symlog",
    )
    axes[0, 0].legend()
    axes[0, 1].legend()
    experiment.save("calibration", figure, result)
    return result
