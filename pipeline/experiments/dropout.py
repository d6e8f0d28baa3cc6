"""Deliberate GPS dropout, with and without smoothing (Seo et al. 2005)."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.experiments.base import (
    Experiment,
    horizontal_distance,
    largest_in,
    new_figure,
    outage_windows,
    rms,
    without,
)


def run(experiment: Experiment, off_s: float, every_s: float) -> dict[str, Any]:
    """Cut the fixes, fuse, and compare filter and smoother with the run on all fixes."""
    inputs, options = experiment.inputs, experiment.options
    windows = outage_windows(inputs.fixes, off_s, every_s, every_s - off_s)
    reference = inputs.fuse(options).trajectory
    cut = inputs.fuse(options, without(inputs.fixes, windows))
    figure, axes = new_figure(2, 1, (10, 7))
    t = reference.gps_s - reference.gps_s[0]
    result: dict[str, Any] = {"outage_s": off_s, "outages": len(windows)}
    for row, (name, trajectory) in enumerate(
        (("filter", cut.filtered), ("smoother", cut.trajectory))
    ):
        distance = horizontal_distance(trajectory, reference)
        sigma = np.hypot(trajectory.sd_pos_ned[:, 0], trajectory.sd_pos_ned[:, 1])
        worst = largest_in(distance, trajectory.gps_s, windows)
        result[f"{name}_rms_of_largest_m"] = rms(worst)
        result[f"{name}_largest_m"] = float(worst.max(initial=0.0))
        plot = axes[row, 0]
        for start, stop in windows:
            plot.axvspan(start - reference.gps_s[0], stop - reference.gps_s[0], color="0.92")
        plot.plot(t, distance, "C0", lw=1, label="distance to the run on all fixes")
        plot.plot(t, sigma, "C1", lw=1, label="one sigma said")
        plot.set(ylabel=f"{name}, m", xlabel="time, s" if row else "", ylim=(0, None))
        plot.legend()
    axes[0, 0].set_title(f"GPS off for {off_s:.0f} s in every {every_s:.0f} s (grey)")
    experiment.save("dropout", figure, result)
    return result
