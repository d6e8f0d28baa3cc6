"""The paper's Fig. 5: the estimated sensor biases over time with their sigma."""

from __future__ import annotations

from typing import Any

from automap.effects.catalogue import bias_walks
from pipeline.experiments.base import Experiment, new_figure


def run(experiment: Experiment) -> dict[str, Any]:
    """Plot the forward filter's and the smoothed biases with three-sigma bands.

    The filter's band narrows while the drive goes on, the smoother's holds from the start.
    """
    fused = experiment.inputs.fuse(experiment.options)
    history, running = fused.parameters, fused.filtered_parameters
    t_running = (running.t_ns - history.t_ns[0]) * 1e-9
    t = (history.t_ns - history.t_ns[0]) * 1e-9
    figure, axes = new_figure(3, 2, (11, 8))
    result: dict[str, Any] = {}
    for column, effect in enumerate(bias_walks().values()):
        for row, parameter in enumerate(effect.parameters):
            name, unit = f"{effect.name}_{parameter.name}", parameter.unit
            if name not in history.names:
                continue
            i = history.names.index(name)
            value, sd = history.values[:, i], history.sd[:, i]
            plot = axes[row, column]
            live, live_sd = running.values[:, i], running.sd[:, i]
            plot.fill_between(
                t_running, live - 3 * live_sd, live + 3 * live_sd, color="C1", alpha=0.2, lw=0
            )
            plot.fill_between(t, value - 3 * sd, value + 3 * sd, color="C0", alpha=0.3, lw=0)
            plot.plot(t_running, live, "C1", lw=1, label="forward filter")
            plot.plot(t, value, "C0", lw=1, label="smoothed")
            # the first seconds know nothing: they would flatten all that follows
            settled = live_sd[t_running > min(10.0, 0.2 * float(t_running[-1]))]
            reach = 4.0 * float(settled.max()) if len(settled) else 4.0 * float(live_sd.max())
            plot.set_ylim(float(value.min()) - reach, float(value.max()) + reach)
            plot.set(ylabel=f"{name}, {unit}", xlabel="time, s" if row == 2 else "")
            result[name] = {
                "end": float(value[-1]),
                "sd": float(sd[-1]),
                "sd_filter_start": float(live_sd[0]),
                "sd_filter_end": float(live_sd[-1]),
            }
    for plot in axes.flat:
        plot.margins(x=0.0)
    axes[0, 0].legend(loc="upper right")
    figure.suptitle("sensor biases with three sigma")
    experiment.save("biases", figure, result)
    return result
