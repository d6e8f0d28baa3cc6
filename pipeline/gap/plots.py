"""Plots of gap.html: measurement and simulation on top of each other, spectra, error bars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from automap.fusion.layout import CHANNELS
from automap.gap.fit import whitened_innovations
from automap.gates import mean_square_limits
from automap.records import FloatArray
from pipeline.pages.section import Plot, draw, draw_over_time
from pipeline.pages.svg_plot import Series
from pipeline.report.channels import channel_name

if TYPE_CHECKING:
    from automap.gap.camera.fit import CameraFit
    from automap.gap.fit import Fit

WINDOW_S = 5.0
SHOWN_S = 25.0
SETTLED_S = 10.0
LEAST = 30
SEGMENTS = 8
CLIP = 10.0


@dataclass(frozen=True)
class _Scalars:
    """One channel's measurements: ``t`` [m] s, ``innovation`` and its ``sd`` [m]."""

    t: FloatArray
    innovation: FloatArray
    sd: FloatArray


def _channel(fit: Fit, name: str) -> _Scalars | None:
    store = fit.last.forward.store
    rows = store.info[:, 1] == CHANNELS.index(name)
    if int(rows.sum()) < LEAST:
        return None
    t = fit.last.nodes.t[store.info[rows, 0]]
    return _Scalars(t, store.nu[rows], np.sqrt(store.var[rows]))


def overlay(before: Fit, after: Fit, name: str, unit: str) -> list[Plot]:
    """Measurement and simulation of a channel where the old model's errs most.

    Everything relative to what the new model predicts, for a car goes much further in these
    seconds than the models differ.
    """
    old, new = _channel(before, name), _channel(after, name)
    if old is None or new is None:
        return []
    # the same measurements, though a delay may have moved them in time
    same = len(old.t) == len(new.t)
    past = old.innovation if same else np.interp(new.t, old.t, old.innovation)
    errs = np.clip(past / new.sd, -CLIP, CLIP) ** 2
    errs -= np.clip(new.innovation / new.sd, -CLIP, CLIP) ** 2
    # at the start nothing is known yet, and its band would hide all else
    settled = int(np.searchsorted(new.t, new.t[0] + SETTLED_S))
    settled = settled if len(errs) - settled >= LEAST else 0
    count = max(int(np.searchsorted(new.t, new.t[0] + SHOWN_S)), 2)
    count = min(count, len(errs) - settled)
    first = settled + int(np.argmax(np.convolve(errs[settled:], np.ones(count), mode="valid")))
    rows = slice(first, first + count)
    t = new.t[rows] - new.t[rows][0]
    title = f"{channel_name(name)}, from {new.t[first]:.0f} s into the held-out data"
    band = 2.0 * new.sd[rows]
    return draw_over_time(
        title,
        [
            Series("new model, 95 %", t, -band, "band", 0, upper=band),
            Series("old model", t, (new.innovation - past)[rows], "line", "bad"),
            Series("measured", t, new.innovation[rows], "dots", 1),
        ],
        f"against the new model, {unit}",
        float(t[-1]),
        include=(0.0,),
    )


def running(before: Fit, after: Fit, name: str) -> list[Plot]:
    """Innovations over their stated sd, root mean square of some seconds."""
    lines = [_running(f, name) for f in (before, after)]
    if lines[0] is None or lines[1] is None:
        return []
    (x0, y0), (x1, y1) = lines[0], lines[1]
    return draw_over_time(
        channel_name(name),
        [Series("before", x0, y0, "line", "bad"), Series("after", x1, y1, "line", 0)],
        "innovation / sd",
        float(x0[-1]),
        include=(0.0, 1.0),
    )


def _running(fit: Fit, name: str) -> tuple[FloatArray, FloatArray] | None:
    whitened, t, channels = whitened_innovations(fit)
    rows = channels == CHANNELS.index(name)
    return _rms_over(t[rows], whitened[rows])


def _rms_over(t: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    if len(t) < LEAST:
        return None
    w = np.clip(w, -CLIP, CLIP)
    edges = np.arange(t[0], t[-1] + WINDOW_S, WINDOW_S)
    index = np.clip(np.digitize(t, edges) - 1, 0, len(edges) - 1)
    count = np.bincount(index, minlength=len(edges)).astype(float)
    squares = np.bincount(index, weights=w**2, minlength=len(edges))
    with np.errstate(invalid="ignore", divide="ignore"):
        level = np.sqrt(squares / count)
    return edges + 0.5 * WINDOW_S, level


def spectrum(before: Fit, after: Fit, name: str) -> list[Plot]:
    """Spectra of the normalised innovations; a right model's is flat at one, within the band
    that 95 % of its own simulations keep."""
    curves = [_spectrum(f, name) for f in (before, after)]
    if curves[0] is None or curves[1] is None:
        return []
    (f0, p0, k), (f1, p1, _) = curves[0], curves[1]
    low, high = (float(limit) for limit in mean_square_limits(2 * k))
    title = f"spectrum of {channel_name(name)}"
    series = [
        Series("simulated, 95 %", f1, np.full(len(f1), low), "band", 1, np.full(len(f1), high)),
        Series("before", f0, p0, "line", "bad"),
        Series("after", f1, p1, "line", 0),
    ]
    return draw(title, series, "power, 1 is white", "frequency, Hz", (0.1, 10.0), log=True)


def _spectrum(fit: Fit, name: str) -> tuple[FloatArray, FloatArray, int] | None:
    """Frequencies in Hz, power and number of independent segments."""
    whitened, t, channels = whitened_innovations(fit)
    rows = channels == CHANNELS.index(name)
    w, at = np.clip(whitened[rows], -CLIP, CLIP), t[rows]
    if len(w) < 4 * SEGMENTS:
        return None
    from scipy.signal import welch

    step = max(float(np.median(np.diff(at))), 1e-3)
    length = max(2 * len(w) // (SEGMENTS + 1), 8)
    frequency, power = welch(w, 1.0 / step, nperseg=length, detrend=False)
    # white noise of size one has twice the step as its one-sided density
    return frequency[1:-1], power[1:-1] / (2.0 * step), SEGMENTS


def error_bars(before: Fit, after: Fit) -> list[Plot]:
    """What the trajectory's error bars become."""
    old, new = _bars(before), _bars(after)
    end = float(new[0][-1])
    plots = draw_over_time(
        "horizontal position of the held-out drive, one sigma",
        [
            Series("before", old[0], old[1], "line", "bad"),
            Series("after", new[0], new[1], "line", 0),
        ],
        "m",
        end,
        include=(0.0,),
    )
    return plots + draw_over_time(
        "heading of the held-out drive, one sigma",
        [
            Series("before", old[0], old[2], "line", "bad"),
            Series("after", new[0], new[2], "line", 0),
        ],
        "deg",
        end,
        include=(0.0,),
    )


def _bars(fit: Fit) -> tuple[FloatArray, FloatArray, FloatArray]:
    cov = fit.last.smooth.cov[:]
    place = np.sqrt(np.maximum(cov[:, 0, 0] + cov[:, 1, 1], 0.0))
    return fit.last.nodes.t, place, np.degrees(np.sqrt(np.maximum(cov[:, 8, 8], 0.0)))


def camera_plots(before: CameraFit, after: CameraFit) -> list[Plot]:
    """Residuals of the boxes over their sd along the held-out drive."""
    out = []
    names = ("to the right in the picture", "down in the picture", "size of the box")
    for i, name in enumerate(names):
        old = _rms_over(before.boxes.t, before.residual[:, i])
        new = _rms_over(after.boxes.t, after.residual[:, i])
        if old is not None and new is not None:
            out += draw_over_time(
                name,
                [
                    Series("before", old[0], old[1], "line", "bad"),
                    Series("after", new[0], new[1], "line", 0),
                ],
                "residual / sd",
                float(old[0][-1]),
                include=(0.0, 1.0),
            )
    return out
