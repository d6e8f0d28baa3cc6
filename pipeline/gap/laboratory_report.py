"""gap.html of desk logs: what the poses and turns of a sensor still lack."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipeline.gap.effect_words import sentence_case
from pipeline.gap.remedies import TAKE_MODEL
from pipeline.gap.report import findings_table
from pipeline.gap.words import finding_words
from pipeline.pages.render import sections_page
from pipeline.pages.section import Figure, Section, draw_over_time
from pipeline.pages.svg_plot import Series

if TYPE_CHECKING:
    from automap.gap.laboratory import LaboratoryResult


def laboratory_report(result: LaboratoryResult, names: Sequence[str]) -> str:
    """The page of a search on desk logs."""
    figures = [
        Figure(f"{1e3 * result.gap_before:.2f} mm/s²", "norm off gravity before", "held-out poses"),
        Figure(f"{1e3 * result.gap_after:.2f} mm/s²", "norm off gravity after", "held-out poses"),
        Figure(str(len(result.poses.accel_before)), "rest poses", "each judged by the others"),
    ]
    section = Section(sentences=[sentence_case(result.verdict) + "."])
    section.paragraphs = [finding_words(f, None, TAKE_MODEL) for f in result.findings]
    poses = np.arange(len(result.poses.accel_before), dtype=float)
    plots = Section()
    plots.plots += draw_over_time(
        "Norm off gravity of held-out poses, mm/s²",
        [
            Series("before", poses, 1e3 * result.poses.accel_before, "dots", "bad"),
            Series("after", poses, 1e3 * result.poses.accel_after, "dots", 0),
        ],
        "mm/s²",
        1.0,
        include=(0.0,),
    )
    turns = np.arange(len(result.poses.gyro_before), dtype=float)
    plots.plots += draw_over_time(
        "Gravity after held-out turns, degrees off",
        [
            Series("before", turns, np.degrees(result.poses.gyro_before), "dots", "bad"),
            Series("after", turns, np.degrees(result.poses.gyro_after), "dots", 0),
        ],
        "deg",
        1.0,
        include=(0.0,),
    )
    parts = [
        ("In words", section),
        ("What is missing", findings_table(result.findings)),
        ("Before and after", plots),
    ]
    return sections_page("Gap", ", ".join(names), figures, parts)
