"""NIS monitoring: are the innovations as large as the filter says."""

from __future__ import annotations

from typing import Any

import numpy as np

from automap.gates import mean_square_limits
from pipeline.experiments.base import Experiment, new_figure

WINDOW = 50
"""Epochs of the moving mean: its band is then narrow enough to show a wrong sigma."""
_BLOCKS = ("position", "velocity")


def run(experiment: Experiment) -> dict[str, Any]:
    """Plot the moving mean of the normalised innovation squared with its 95 % band."""
    from automap.fusion.consistency import channel_consistency, innovation_doubts

    table = experiment.inputs.fuse(experiment.options).innovations
    figure, axes = new_figure(2, 1, (10, 7))
    result: dict[str, Any] = {
        "doubts": [reason.text for reason in innovation_doubts(channel_consistency(table))]
    }
    for row, block in enumerate(_BLOCKS):
        names = sorted({str(c) for c in table.channel if str(c).startswith(block)})
        if not names:
            continue
        # scalars were decorrelated by processing them in turn: squares add up
        square = (table.innovation / table.sd) ** 2
        member = np.isin(table.channel.astype(str), names)
        stamps, inverse = np.unique(table.t_ns[member], return_inverse=True)
        total = np.bincount(inverse, square[member])
        count = np.bincount(inverse)
        t = (stamps - stamps[0]) * 1e-9
        width = min(WINDOW, len(total))
        kernel = np.full(width, 1.0)
        ratio = np.convolve(total, kernel, "valid") / np.convolve(count, kernel, "valid")
        dof = float(np.median(count)) * width
        plot = axes[row, 0]
        # a window over a gap in the recording has its middle nowhere near its epochs
        span = t[width - 1 :] - t[: len(ratio)]
        middle = t[: len(ratio)] + 0.5 * span
        shown = np.where(span < 2.0 * np.median(span), ratio, np.nan)
        plot.plot(middle, shown, "C0", lw=1)
        low, high = (float(limit) for limit in mean_square_limits(dof))
        plot.axhspan(low, high, color="0.88", label="95 % if the model is right")
        plot.axhline(1.0, color="k", lw=0.5)
        plot.set(ylabel=f"{block}: NIS per degree of freedom", xlabel="time, s")
        plot.set_ylim(min(0.9 * low, 0.95 * ratio.min()), max(1.1 * high, 1.05 * ratio.max()))
        plot.legend()
        inside = (ratio > low) & (ratio < high)
        result[block] = {
            "mean": float(total.sum() / count.sum()),
            "share_inside_95": float(inside.mean()),
        }
    axes[0, 0].set_title(f"mean over {WINDOW} epochs")
    experiment.save("nis", figure, result)
    return result
