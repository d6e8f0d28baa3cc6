"""What pages consist of: key figures, and sections of sentences, plots and tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from pipeline.pages.svg_plot import Series, plot, thin_line, time_unit

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Figure:
    """A key figure: its value as text, what it is, and a line on how to read it."""

    value: str
    name: str
    note: str


@dataclass(frozen=True)
class Plot:
    """One plot: its SVG text, its title and what each series is (label, colour class)."""

    title: str
    svg: str
    legend: tuple[tuple[str, str], ...] = ()


@dataclass
class Section:
    """Sentences, plots and a table for one part of the page; ``paragraphs`` are pairs of what it is
    about and the text.

    ``absent`` says why the section is empty; with ``folded`` the table hides under that title.
    """

    sentences: list[str] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)
    header: tuple[str, ...] = ()
    rows: list[tuple[str, ...]] = field(default_factory=list)
    verdicts: list[tuple[Literal["good", "fair", "bad"], str]] = field(default_factory=list)
    absent: str = ""
    folded: str = ""
    paragraphs: list[tuple[str, str]] = field(default_factory=list)


def draw(
    title: str,
    series: Sequence[Series],
    y_label: str,
    x_label: str,
    include: Sequence[float] = (),
    log: bool = False,
) -> list[Plot]:
    """A plot with its legend as a list of one, or an empty list when there is nothing to draw."""
    shown = [s for s in series if len(s.x)]
    svg = plot(shown, title, y_label, x_label, log=log, include=include)
    if not svg:
        return []
    legend = tuple((s.label, s.css) for s in shown if s.label)
    # one series in the first colour is what the title says
    told = len(legend) > 1 or any(css != "c0" for _, css in legend)
    return [Plot(title, svg, legend if told else ())]


def draw_over_time(
    title: str,
    series: Sequence[Series],
    y_label: str,
    seconds: float,
    include: Sequence[float] = (),
    log: bool = False,
) -> list[Plot]:
    """The same over time: ``series`` have seconds for x and are shown in the unit that suits
    ``seconds``, the span."""
    scale, unit = time_unit(seconds)
    thinned = map(thin_line, series)
    scaled = [replace(s, x=s.x / scale) for s in thinned]
    return draw(title, scaled, y_label, f"time, {unit}", include, log)
