"""``automap gap``: drives in; gap.json, model.toml and gap.html out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import ConfigError
from pipeline.gap.cost_json import held_out_json

if TYPE_CHECKING:
    from automap.gap import Finding, GapResult, Unexplained
    from pipeline.calibrate.logs import LogSource
    from pipeline.shared.progress import Progress

GAP = "gap.json"
MODEL = "model.toml"
REPORT = "gap.html"
MISFITS = 5
"""So many are printed; all are on the page."""


@dataclass(frozen=True)
class GapOutcome:
    """What to tell, and the files."""

    lines: tuple[str, ...]
    files: tuple[Path, ...]


def find(
    drives: Sequence[Path],
    holdout: Sequence[Path],
    config: Path | None,
    without: Sequence[str],
    out: Path,
    progress: Progress = lambda fraction, text: None,
) -> GapOutcome:
    """Search the drives and write the three files into ``out``.

    Raises ConfigError for a model or an effect that does not exist, InputError for a drive
    that cannot be used.
    """
    from automap.effects import effect_named
    from automap.gap import find_gaps
    from automap.gap.finder import with_cameras
    from automap.io.atomic import make_folder, write_json, write_text
    from pipeline.gap.camera import camera_gaps, camera_json, camera_lines
    from pipeline.gap.inputs import gap_drives, gap_model
    from pipeline.gap.model import model_toml
    from pipeline.gap.report import gap_report

    _check_distinct([*drives, *holdout])
    model, settings = gap_model(config)
    for name in without:
        effect_named(name)
    make_folder(out)
    progress(0.02, "reading")
    noted: list[str] = []
    fitted = gap_drives(drives, out / "runs", settings, noted.append)
    held = gap_drives(holdout, out / "runs", settings, noted.append)
    done = 0

    def log(text: str) -> None:
        nonlocal done
        done += 1
        # nobody knows how many effects there will be
        progress(1.0 - 0.9 * 0.97**done, text)

    result = find_gaps(fitted, held, model, without, log)
    result = replace(result, warnings=(*noted, *result.warnings))
    for text in result.warnings:
        print(f"warning: {text}", file=sys.stderr)
    lines = camera_lines([], settings)
    write_text(out / MODEL, model_toml(result, fitted, settings.effects, out, lines))
    cameras, troubles = camera_gaps(drives, holdout, out / "runs", out / MODEL, without, log)
    for text in [*troubles, *(t for c in cameras for t in c.warnings)]:
        print(f"warning: {text}", file=sys.stderr)
    result = with_cameras(result, cameras, troubles)
    lines = camera_lines(cameras, settings)
    write_text(out / MODEL, model_toml(result, fitted, settings.effects, out, lines))
    write_json(out / GAP, {**as_json(result), "cameras": [camera_json(c) for c in cameras]})
    write_text(out / REPORT, gap_report(result, [d.name for d in fitted], cameras))
    progress(1.0, "done")
    return GapOutcome(tuple(_lines(result)), (out / GAP, out / MODEL, out / REPORT))


def _check_distinct(drives: Sequence[Path]) -> None:
    resolved = [d.resolve() for d in drives]
    for i, path in enumerate(resolved):
        if path in resolved[:i]:
            raise ConfigError(f"{drives[i]} is given twice; leave out one of them")


def as_json(result: GapResult) -> dict[str, Any]:
    """The content of gap.json."""
    from pipeline.gap.model import left_to_runs

    formulas = [_formula_json(f) for f in result.formulas]
    return {
        "schema": "automap.gap/1",
        "gap_before": result.gap_before,
        "gap_after": result.gap_after,
        "unit": "nats an epoch of fixes, on held-out data",
        "channels": [
            {
                "channel": c.channel,
                "gap_before": c.gap_before,
                "gap_after": c.gap_after,
                "rms_before": c.rms_before,
                "rms_after": c.rms_after,
                "correlation_before": c.correlation_before,
                "correlation_after": c.correlation_after,
                "worst": c.worst_manoeuvre,
            }
            for c in result.channels
        ],
        "findings": [_finding_json(f) for f in result.findings],
        "where": [
            {
                "channel": p.channel,
                "manoeuvre": p.manoeuvre,
                "count": p.count,
                "nis_before": p.before,
                "nis_after": p.after,
            }
            for p in result.places
        ],
        "noise": dict(result.noise),
        "sync": dict(result.sync),
        "unexplained": formulas[0] if formulas else None,
        "formulas": formulas,
        "misfits": [
            {
                "channel": m.channel,
                "kind": m.kind,
                "where": m.where,
                "size": m.size,
                "p_value": m.p_value,
            }
            for m in result.misfits
        ],
        "noise_claims": [
            {
                "level": c.level,
                "factor": c.factor,
                "evidence_nats": c.evidence_nats,
                "p_value": c.p_value,
                "condition": c.condition or None,
                "elsewhere": c.elsewhere if c.condition else None,
                "cause": c.cause or None,
            }
            for c in result.noise_claims
        ],
        "refused": [
            {"effect": r.effect, "evidence_nats": r.evidence_nats, "p_value": r.p_value}
            for r in result.refused
        ],
        **held_out_json(result),
        "alike": [
            {"effects": list(a.effects), "share": a.share, "advice": a.advice}
            for a in result.unclear.alike
        ],
        "hardly_shown": list(result.unclear.hidden),
        "verdict": result.verdict,
        "warnings": list(result.warnings),
        "left_to_runs": {k: list(v) for k, v in left_to_runs(result).items()},
    }


def _formula_json(one: Unexplained) -> dict[str, Any]:
    return {
        "channel": one.channel,
        "formula": one.formula,
        "coefficient": one.coefficient,
        "sd": one.sd,
        "evidence_nats": one.evidence_nats,
        "p_value": one.p_value,
        "resembles": one.resembles,
        "same_as": one.same_as or None,
        "confusable_with": list(one.confusable_with),
        "effect": one.effect,
        "gap_before": one.gap_before,
        "gap_after": one.gap_after,
        "terms": [
            {
                "channel": term.channel,
                "formula": term.text,
                "coefficient": term.coefficient,
                "sd": term.sd,
            }
            for term in one.terms
        ],
    }


def _finding_json(f: Finding) -> dict[str, Any]:
    return {
        "effect": f.effect,
        "parameters": {
            p: {"value": v.value, "sd": v.sd if isfinite(v.sd) else None, "unit": v.unit}
            for p, v in f.parameters.items()
        },
        "evidence_nats": f.evidence_nats,
        "p_value": f.p_value,
        "gap_before": f.gap_before,
        "gap_after": f.gap_after,
        "confusable_with": list(f.confusable_with),
        "advice": f.advice,
        "resembles": f.resembles or None,
        "same_as": f.same_as or None,
        "drift": None if f.drift is None else asdict(f.drift),
    }


def _lines(result: GapResult) -> list[str]:
    from automap.gap.result import p_text
    from pipeline.gap.model import left_to_runs

    left = left_to_runs(result)
    lines = [result.verdict, *(_line(f, left.get(f.effect, ())) for f in result.findings)]
    for one in result.formulas:
        like = f"; resembles {one.resembles}" if one.resembles else ""
        like += f"; the same is {one.same_as}" if one.same_as else ""
        lines.append(
            f"  {one.formula}: {one.numbers} ({one.evidence_nats:.0f} nats, "
            f"p {p_text(one.p_value)}){like}"
        )
    lines += [f"  noise is not as stated: {c}" for c in result.noise_claims]
    lines += [f"  not explained: {m}" for m in result.misfits[:MISFITS]]
    if len(result.misfits) > MISFITS:
        lines.append(f"  not explained: {len(result.misfits) - MISFITS} more in {REPORT}")
    return lines


def _line(f: Finding, instead: Sequence[str] = ()) -> str:
    from automap.gap.result import p_text

    numbers = ", ".join(f"{p} {v}" for p, v in f.parameters.items())
    line = f"  {f.effect}: {numbers} ({f.evidence_nats:.0f} nats, p {p_text(f.p_value)})"
    if f.confusable_with:
        line += f"; not to be told from {', '.join(f.confusable_with)}"
    if f.resembles:
        line += f"; it may be {f.resembles}"
    if f.same_as:
        line += f"; the same is {f.same_as}"
    if instead:
        line += f"; left out of the model, since a run estimates {', '.join(instead)} anyhow"
    return line


def find_in_logs(
    source: LogSource,
    out: Path,
    gravity: float | None,
    place: tuple[float, float] | None,
    without: Sequence[str] = (),
) -> GapOutcome:
    """Search multi-pose desk logs; writes gap.json, model.toml and gap.html into ``out``.

    Raises InputError where the log has no rest poses.
    """
    from automap.gap.laboratory import find_laboratory_gaps
    from automap.io.atomic import make_folder, write_json, write_text
    from pipeline.calibrate.logs import local_gravity, read_logs
    from pipeline.gap.laboratory_report import laboratory_report

    logs = read_logs(source)
    g, warnings = local_gravity(gravity, place)
    for text in warnings:
        print(f"warning: {text}", file=sys.stderr)
    result = find_laboratory_gaps([log.data for log in logs], g, without)
    make_folder(out)
    findings = [_finding_json(f) for f in result.findings]
    write_json(
        out / GAP,
        {
            "schema": "automap.gap/1",
            "gap_before": result.gap_before,
            "gap_after": result.gap_after,
            "unit": "m/s^2, rms of the norm off gravity on held-out poses",
            "channels": [],
            "findings": findings,
            "noise": {},
            "unexplained": None,
            "verdict": result.verdict,
        },
    )
    lines = [f"# {result.verdict}", "# Errors of the reading, as automap.gap found them."]
    for f in result.findings:
        lines += ["", f"[fuse.fixed.{f.effect}]"]
        lines += [f"{p} = {v.value:.9g}" for p, v in f.parameters.items()]
    write_text(out / MODEL, "\n".join(lines) + "\n")
    write_text(out / REPORT, laboratory_report(result, [log.data.name for log in logs]))
    lines = [result.verdict] + [_line(f) for f in result.findings]
    return GapOutcome(tuple(lines), (out / GAP, out / MODEL, out / REPORT))
