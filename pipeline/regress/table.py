"""What moved, as text."""

from __future__ import annotations

from collections.abc import Sequence

from automap.regression.change import Change
from pipeline.regress.session import DriveResult

_HEAD = ("", "figure", "then", "now", "moved by", "allowed")


def lines_of(result: DriveResult, everything: bool = False) -> list[str]:
    """The result of a drive: its verdict, then a table of what moved (or of every figure)."""
    lines = [f"{result.name}: {_verdict(result)}"]
    if result.error:
        lines.append(f"  {result.error}")
    shown = [c for c in result.changes if everything or _is_told(c, result)]
    return lines + _table(shown)


def _verdict(result: DriveResult) -> str:
    if result.now is None or result.then is None:
        return result.verdict
    judged = [c for c in result.changes if not c.information]
    if result.moved:
        return f"{len(result.moved)} of {len(judged)} figures moved"
    largest = max((c.sigmas for c in judged if c.sigmas is not None), default=0.0)
    return f"same, {len(judged)} figures within {largest:.2g} σ"


def _is_told(change: Change, result: DriveResult) -> bool:
    """What moved; beside it whatever explains or weighs it."""
    if change.moved:
        return True
    if not change.information or change.group == "timing":
        return False
    return bool(change.size) and (change.group == "run" or bool(result.moved))


def _table(changes: Sequence[Change]) -> list[str]:
    if not changes:
        return []
    rows = [_HEAD]
    group = ""
    for change in changes:
        label = change.group if change.group != group else ""
        group = change.group
        rows.append((label, change.name, change.then, change.now, change.extent, change.limit))
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEAD))]
    return [
        "  "
        + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
