"""The paper's Fig. 5: the estimated sensor biases over time with their sigma."""

from __future__ import annotations

from typing import Any

from pipeline.experiments.base import Experiment, new_figure


def run(experiment: Experiment) -> dict[str, Any]:
    """Plot smoothed biases with three-sigma bands."""
    history = experiment.inputs.fuse(experiment.options).parameters
    t = (history.t_ns - history.t_ns[0]) * 1e-9
    figure, axes = new_figure(3, 2, (11, 8))
    result: dict[str, Any] = {}
    for column, (effect, unit) in enumerate((("accel_bias", "m/s^2"), ("gyro_bias", "rad/s"))):
        for row, axis in enumerate("xyz"):
            name = f"{effect}_{axis}"
            if name not in history.names:
                continue
            i = history.names.index(name)
            value, sd = history.values[:, i], history.sd[:, i]
            plot = axes[row, column]
            plot.fill_between(t, value - 3 * sd, value + 3 * sd, color="0.85")
            plot.plot(t, value, "C0")
            plot.set(ylabel=f"{name}, {unit}", xlabel="time, s" if row == 2 else "")
            result[name] = {"end": float(value[-1]), "sd": float(sd[-1])}
    for plot in axes.flat:
        plot.margins(x=0.0)
    figure.suptitle("smoothed sensor biases, grey: three sigma")
    experiment.save("biases", figure, result)
    return result
