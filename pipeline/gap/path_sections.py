"""Sections of gap.html about the held-out path: before and after, and what each effect costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from automap.gap.confirm import cost_between, held_path
from pipeline.gap.path_plots import path_plots
from pipeline.gap.sizes import about
from pipeline.gap.words import LEAST_M
from pipeline.pages.section import Figure, Section

if TYPE_CHECKING:
    from automap.gap import GapResult


def path_figure(result: GapResult) -> Figure:
    """How far the held-out path moves, as a key figure."""
    before, after = (
        [held_path(fit) for fit in fits] if result.findings or result.formulas else []
        for fits in result.held_out
    )
    if not before or not after:
        return Figure("0 m", "the held-out path moves", "no effect is missing")
    cost = cost_between(after, before)
    largest = about(cost.level.largest, "m", LEAST_M)
    rms = about(cost.level.rms, "m", LEAST_M)
    return Figure(rms, "the held-out path moves", f"level, rms; at most {largest}")


def path_section(result: GapResult) -> Section:
    """The first held-out drive under both models, from above and along time."""
    before, after = result.held_out
    if not before or not after:
        return Section(absent="No held-out data.")
    sentence = (
        "The smoothed path of the IMU under the old and the new model at the same stamps, and the "
        "fixes of the antenna. Neither model was fitted to these data. What differs "
        "along the road, as with a delay, shows over time only."
    )
    return Section([sentence], path_plots(before[0], after[0]))


def cost_section(result: GapResult) -> Section:
    """What each effect costs on held-out data, as a table."""
    names = ("level", "height", "heading", "tilt")
    header = ("effect", *(f"{n}, {'m' if n in names[:2] else '°'}" for n in names))
    section = Section(header=header)
    if not result.costs:
        section.absent = "Nothing was found that would cost anything."
        return section
    section.sentences.append(
        "How far the smoothed held-out path is off where one effect is left out of the new model: "
        "root mean square, and at most. Noise is compared with noise as stated."
    )
    for name, cost in result.costs.items():
        metres = [f"{e.rms:.3f}, {e.largest:.3f}" for e in (cost.level, cost.height)]
        angles = [np.degrees([e.rms, e.largest]) for e in (cost.heading, cost.tilt)]
        section.rows.append((name, *metres, *(f"{a:.3f}, {b:.3f}" for a, b in angles)))
    return section
