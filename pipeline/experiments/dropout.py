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
    shade_outages,
    without,
)

START_S = 2.0
"""Seconds in which the forward filter finds itself."""


def run(experiment: Experiment, off_s: float, every_s: float) -> dict[str, Any]:
    """Cut the fixes, fuse, and compare filter and smoother with the run on all fixes."""
    inputs, options = experiment.inputs, experiment.options
    windows = outage_windows(inputs.fixes, off_s, every_s, every_s - off_s)
    reference = inputs.fuse(options).trajectory
    left = without(inputs.fixes, windows)
    cut = inputs.fuse(options, left)
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
        shade_outages(plot, left, windows, float(reference.gps_s[0]))
        plot.plot(t, distance, "C0", lw=1, label="distance to the run on all fixes")
        plot.plot(t, sigma, "C1", lw=1, label="one sigma said")
        # the filter's first sigma, before any fix, would flatten all the rest
        top = 1.15 * max(float(distance.max()), float(sigma[t > START_S].max(initial=0.0)))
        plot.set(ylabel=f"{name}, m", xlabel="time, s" if row else "", ylim=(0, top))
        plot.legend()
    title = f"GPS off for {off_s:.0f} s in every {every_s:.0f} s (grey; hatched: none recorded)"
    axes[0, 0].set_title(title)
    experiment.save("dropout", figure, result)
    return result
