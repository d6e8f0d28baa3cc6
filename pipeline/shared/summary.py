"""What came of a run, in a few lines and as JSON."""

from __future__ import annotations

from typing import Any

from automap.io import names
from automap.io.atomic import plain
from pipeline.shared.progress import Outcome
from pipeline.shared.verdicts import KEYS, Told, verdicts

_SHOWN = (("fuse", "trajectory"), ("detect", "detections"), ("geolocate", "signs"))
_JUDGED = {"fuse": "path", "geolocate": "signs"}


def summary_lines(outcome: Outcome) -> list[str]:
    """The run in a few lines, the last one with where the map is; none after a failure.

    The verdicts stand below what they are of, with reasons; a good one with what else is to be
    known.
    """
    finished = [line for line in outcome.stages if line.state in ("ran", "kept")]
    if outcome.error is not None or len(finished) != len(outcome.stages) or not finished:
        return []
    ran = sum(line.state == "ran" for line in finished)
    seconds = outcome.record.get("seconds", 0.0)
    warnings = len(outcome.record.get("warnings", []))
    told = f"{warnings} warning{'s' if warnings != 1 else ''}" if warnings else "no warnings"
    lines = [f"{outcome.name}: {ran} of {len(finished)} stages ran in {seconds:.1f} s, {told}"]
    stages = outcome.record.get("stages", {})
    for stage, label in _SHOWN:
        result = stages.get(stage, {}).get("result")
        if result:
            lines.append(f"  {label:<11} {result}")
        if stage in _JUDGED:
            lines += _verdict_lines(verdicts(outcome.record).get(_JUDGED[stage]))
    found = [name for name in (names.REPORT, names.KML) if (outcome.out / name).is_file()]
    if found:
        lines.append(f"  {'map':<11} {'  '.join(str(outcome.out / name) for name in found)}")
    return lines


def _verdict_lines(told: Told | None) -> list[str]:
    if told is None:
        return []
    line = told.state
    if told.reasons and told.state != "good":
        line += f", for {len(told.reasons)} reason{'s' if len(told.reasons) != 1 else ''}:"
    return [f"  {'verdict':<11} {line}", *(f"  {'':<11} - {text}" for text in told.reasons)]


def as_dict(outcome: Outcome) -> dict[str, Any]:
    """The outcome as JSON-able values."""
    record = outcome.record
    value = {
        "drive": str(outcome.drive),
        "name": outcome.name,
        "out": str(outcome.out),
        "exit_code": outcome.exit_code,
        "error": str(outcome.error) if outcome.error is not None else None,
        "stages": [
            {
                "name": line.name,
                "state": line.state,
                "reason": line.reason or None,
                "seconds": line.seconds,
                "result": line.result,
            }
            for line in outcome.stages
        ],
        **{key: record.get(key) for key in KEYS.values()},
        "warnings": record.get("warnings", []),
        "metrics": record.get("metrics", {}),
        "map": str(outcome.out / names.KML) if (outcome.out / names.KML).is_file() else None,
    }
    return dict(plain(value))
