"""The paper's Fig. 2: roll and pitch of a resting sensor with and without dynamic calibration.

Ten simulated turn-ons, and the rests of a log with the gyro bias of one of them applied to the
others.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.io.atomic import make_folder
from pipeline.experiments.base import new_figure, save

if TYPE_CHECKING:
    from automap.calibration.rest_sequences import RestSequence


def run(log_path: Path, out: Path, bias_at_s: float | None) -> dict[str, Any]:
    """Plot the sequences of the simulation and of a drive's or log's rests; return figures."""
    from automap.calibration.rest_sequences import log_sequences, simulated_sequences
    from automap.io.imu_log import LogFormat, read_imu_log

    log = read_imu_log(log_path, LogFormat())
    recorded, source_s = log_sequences(log.data, bias_at_s)
    make_folder(out)
    groups = {"simulated": simulated_sequences(), "log": recorded}
    titles = {
        "simulated": "simulated turn-ons",
        "log": f"{log.data.name}, gyro bias of the rest near {source_s:.0f} s",
    }
    figure, axes = new_figure(2, 2, (12, 7))
    for row, (name, sequences) in enumerate(groups.items()):
        _draw(axes[row], sequences, titles[name])
    axes[0, 0].legend(loc="upper left", fontsize=8)
    for plot in axes[-1]:
        plot.set_xlabel("time at rest, s")
    result: dict[str, Any] = {name: _figures(sequences) for name, sequences in groups.items()}
    result["log"]["bias_of_rest_near_s"] = source_s
    save(out, "rest", figure, result)
    return result


def _draw(axes: Any, sequences: list[RestSequence], title: str) -> None:
    sides = ("without dynamic calibration", "with it")
    limit = np.degrees(max(s.drift_without for s in sequences)) * 1.1
    for k, sequence in enumerate(sequences):
        for plot, t, values in (
            (axes[0], sequence.t_s, sequence.without),
            (axes[1], sequence.t_with_s, sequence.with_it),
        ):
            turned = np.degrees(values)
            for i, (style, what) in enumerate((("-", "roll"), ("--", "pitch"))):
                label = what if k == 0 else None
                plot.plot(t, turned[:, i], style, color=f"C{k}", lw=1, label=label)
    for plot, side in zip(axes, sides, strict=True):
        plot.set(title=f"{title}\n{side}", ylabel="turned since the start, deg")
        plot.set_ylim(-limit, limit)
        plot.axhline(0.0, color="k", lw=0.4)


def _figures(sequences: list[RestSequence]) -> dict[str, Any]:
    """Largest drift of each sequence, deg."""
    return {
        "start_s": [round(s.start_s, 2) for s in sequences],
        "seconds": [round(s.seconds, 2) for s in sequences],
        "without_deg": [float(np.degrees(s.drift_without)) for s in sequences],
        "with_deg": [float(np.degrees(s.drift_with)) for s in sequences],
        "last_bias_applied_deg": [float(np.degrees(s.drift_constant)) for s in sequences],
        "own_mean_removed_deg": [float(np.degrees(s.drift_mean)) for s in sequences],
    }


def table(result: dict[str, Any]) -> list[str]:
    """The figures as lines of text."""
    lines = []
    for name, what in (("simulated", "simulated turn-on"), ("log", "rest of the log")):
        part = result[name]
        for k, (start, seconds, without, with_it) in enumerate(
            zip(
                part["start_s"],
                part["seconds"],
                part["without_deg"],
                part["with_deg"],
                strict=True,
            )
        ):
            place = f"{k + 1}" if name == "simulated" else f"from {start:.0f} s"
            lines.append(
                f"{what} {place:11s} {seconds:5.1f} s   without {without:7.3f} deg   "
                f"with {with_it:6.3f} deg"
            )
    return lines
