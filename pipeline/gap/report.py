"""gap.html: what is wrong in words, the path before and after, where the gap is, how sure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING

from automap.gap.result import p_text
from pipeline.gap.path_plots import cost_section, path_figure, path_section
from pipeline.gap.plots import WINDOW_S, camera_plots, error_bars, overlay, running, spectrum
from pipeline.gap.words import in_words
from pipeline.pages.render import sections_page
from pipeline.pages.section import Figure, Plot, Section
from pipeline.report.channels import channel_name

if TYPE_CHECKING:
    from automap.gap import GapResult
    from automap.gap.camera.search import CameraGap
    from automap.gap.fit import Fit
    from automap.gap.result import Finding

OVERLAYS = 2
PLOTS = 4
PLACES = 12


def gap_report(result: GapResult, names: Sequence[str], cameras: Sequence[CameraGap] = ()) -> str:
    """The page of a search on drives called ``names``."""
    found = len(result.findings) + len(result.formulas)
    figures = [
        Figure(str(found), "missing effects", "told in words below"),
        path_figure(result),
        Figure(
            f"{result.gap_before:.3g} → {result.gap_after:.3g}",
            "gap before and after, nats an epoch",
            "on held-out data; 0 is a perfect model",
        ),
    ]
    parts = [
        ("In words", Section(paragraphs=in_words(result))),
        ("The path before and after", path_section(result)),
        ("What is missing, in numbers", _numbers(result)),
        ("What each costs", cost_section(result)),
        ("Measured and simulated", _overlay(result)),
        ("Before and after", _before_after(result)),
        ("Where the gap was", _where(result)),
        ("Not explained", _misfits(result)),
        ("Channels", _channels(result)),
        ("Slow or fast", _spectra(result)),
        ("Error bars", _bars(result)),
        ("What this drive cannot tell", _unclear(result)),
        ("Noise", _noise(result)),
        ("What next", _next(result)),
    ]
    if result.warnings:
        # after the words: what a reader needs first stands there
        noted = Section(verdicts=[("fair", text) for text in result.warnings])
        parts.insert(2, ("Warnings", noted))
    if cameras:
        parts.insert(len(parts) - 2, ("Camera", _cameras(cameras)))
    return sections_page("Gap", ", ".join(names), figures, parts)


def _numbers(result: GapResult) -> Section:
    section = findings_table(result.findings)
    if result.formulas:
        section.absent = ""
    for one in result.formulas:
        section.sentences.append(
            f"{one.formula} with {one.numbers}: {one.evidence_nats:.0f} nats, p "
            f"{p_text(one.p_value)}; no effect of the library."
        )
    return section


def findings_table(findings: Sequence[Finding]) -> Section:
    """The findings with all their numbers."""
    section = Section(
        header=("effect", "values", "evidence, nats", "p", "gap before", "after", "not told from")
    )
    if not findings:
        section.absent = "Nothing stands out above what chance gives."
        return section
    for f in findings:
        values = ", ".join(f"{p} {v}" for p, v in f.parameters.items())
        section.rows.append(
            (
                f.effect,
                values,
                f"{f.evidence_nats:.0f}",
                p_text(f.p_value),
                f"{f.gap_before:.3g}",
                f"{f.gap_after:.3g}",
                ", ".join(f.confusable_with) or "none",
            )
        )
    return section


def _by_gain(result: GapResult) -> list[str]:
    """Channels, those that gained most first."""
    gains = sorted(result.channels, key=lambda c: -(c.rms_before - c.rms_after))
    return [c.channel for c in gains]


def _measured(names: Iterable[str]) -> list[str]:
    """Channels of the receiver; the vehicle constraint is loose on purpose, and what it says has
    a colour of its own."""
    return [name for name in names if name.startswith(("position", "velocity"))]


def _held_out(
    result: GapResult, sentence: str, plots: Callable[[Fit, Fit], Iterable[Plot]]
) -> Section:
    """Plots of the first held-out drive under the old and the new model."""
    before, after = result.held_out
    if not before or not after:
        return Section([sentence], absent="No held-out data.")
    return Section([sentence], list(plots(before[0], after[0])))


def _overlay(result: GapResult) -> Section:
    def plots(before: Fit, after: Fit) -> Iterator[Plot]:
        for name in _measured(_by_gain(result))[:OVERLAYS]:
            yield from overlay(before, after, name, "m" if name.startswith("position") else "m/s")

    return _held_out(
        result,
        "Where the old model errs most: measurements, and what the models predict of them, "
        "all against the new model. Under a right model one dot in twenty lies outside the "
        "band; the line is what the old model predicted.",
        plots,
    )


def _before_after(result: GapResult) -> Section:
    return _held_out(
        result,
        "Innovations of the held-out data over the sd that the model states, root mean "
        f"square of {WINDOW_S:.0f} s. A right model stays near 1.",
        lambda old, new: chain(*(running(old, new, name) for name in _by_gain(result)[:PLOTS])),
    )


def _spectra(result: GapResult) -> Section:
    shown = _measured(c.channel for c in result.channels)
    return _held_out(
        result,
        "How slow or fast the disagreement is. Innovations of a right model have the same "
        "power at all frequencies; simulations from the model stay within the band.",
        lambda old, new: chain(*(spectrum(old, new, name) for name in shown)),
    )


def _bars(result: GapResult) -> Section:
    return _held_out(
        result,
        "Error bars of the smoothed path on the held-out drive under both models. "
        "Bars of the old model are what it claims, not what is true.",
        error_bars,
    )


def _cameras(cameras: Sequence[CameraGap]) -> Section:
    section = Section(header=("camera", "signs", "boxes", "gap before", "gap after"))
    section.sentences.append(
        "Boxes of tracked signs against the path of the new model, every sign's own place and "
        "size free. Gaps are in nats a box on held-out signs."
    )
    for c in cameras:
        if c.held_out is None:
            section.sentences += list(c.warnings)
            continue
        section.rows.append(
            (c.camera, str(c.signs), str(c.boxes), f"{c.gap_before:.3g}", f"{c.gap_after:.3g}")
        )
        if c.findings:
            section.plots += camera_plots(*c.held_out)
    return section


def _where(result: GapResult) -> Section:
    section = Section(header=("channel", "manoeuvre", "measurements", "NIS before", "NIS after"))
    section.sentences.append(
        "Mean squared innovation over its variance by channel and manoeuvre; 1 is right."
    )
    for place in result.places[:PLACES]:
        section.rows.append(
            (
                channel_name(place.channel),
                place.manoeuvre,
                str(place.count),
                f"{place.before:.2f}",
                f"{place.after:.2f}",
            )
        )
    return section


def _misfits(result: GapResult) -> Section:
    section = Section(header=("channel", "where", "variance, times modelled", "p"))
    if not result.misfits:
        section.absent = "What is left is white and of the size that the model states."
        return section
    section.sentences.append(
        "What the innovations of the fitted drives still show, though no candidate explains it: "
        "sigmas are off by the root of these factors there."
    )
    section.rows = [
        (channel_name(m.channel), m.where, f"{m.size:.2f}", p_text(m.p_value))
        for m in result.misfits
    ]
    return section


def _channels(result: GapResult) -> Section:
    section = Section(
        header=("channel", "gap before", "after", "rms before", "after", "memory before", "after")
    )
    section.sentences.append(
        "Gap in nats a measurement by size and colour of the innovations alone; memory is the "
        "correlation of neighbours."
    )
    for c in result.channels:
        section.rows.append(
            (
                channel_name(c.channel),
                f"{c.gap_before:.3f}",
                f"{c.gap_after:.3f}",
                f"{c.rms_before:.2f}",
                f"{c.rms_after:.2f}",
                f"{c.correlation_before:+.2f}",
                f"{c.correlation_after:+.2f}",
            )
        )
    return section


def _unclear(result: GapResult) -> Section:
    section = Section(header=("cannot be told apart", "alike by", "the manoeuvre that would tell"))
    alike, hidden = result.unclear.alike, result.unclear.hidden
    section.sentences.append(
        "Effects that leave the same traces in the fitted drives: where one is named, the other "
        "may be meant."
        if alike
        else "All effects that show at all can be told apart on the fitted drives."
    )
    if hidden:
        section.sentences.append(
            f"These would hardly show at their usual size: {', '.join(hidden)}. A drive with bends "
            "both ways, hard braking, halts and a warm-up shows more."
        )
    for pair in alike:
        section.rows.append((" and ".join(pair.effects), f"{100 * pair.share:.0f} %", pair.advice))
    return section


def _noise(result: GapResult) -> Section:
    section = Section(header=("level", "times the stated"), folded="All noise levels")
    section.sentences.append(
        "Noise was fitted by maximum likelihood before anything was named, and with it."
    )
    section.sentences += [
        f"Not as stated: {c}. What that is beyond noise, nothing here says."
        for c in result.noise_claims
    ]
    section.rows = [(k.replace("_", " "), f"{v:.2f}") for k, v in result.noise.items()]
    return section


def _next(result: GapResult) -> Section:
    section = Section()
    if result.findings or result.formulas:
        section.sentences.append(
            "Use the new model with: automap run DRIVE --config model.toml. Where an effect is a "
            "fault of the installation or of a setting, mend it there instead."
        )
    for f in result.findings:
        if f.advice:
            section.sentences.append(
                f"To tell {f.effect} from {', '.join(f.confusable_with)}: {f.advice}."
            )
    if not section.sentences:
        section.sentences.append(
            "Nothing to do. A drive with bends both ways, hard braking, halts and a warm-up "
            "shows more than a quiet one."
        )
    return section
