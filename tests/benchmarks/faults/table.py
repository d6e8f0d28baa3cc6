"""The table of all runs: for the terminal, and as a page of the documentation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from tests.benchmarks.faults.catalogue import CONTROL, FAULTS
from tests.benchmarks.faults.drives import DRIVES
from tests.benchmarks.faults.judge import MOST_SIGMA, Errors, Row, outcome

HEAD = (
    "drive",
    "fault",
    "exit",
    "verdict",
    "error h, v (m)",
    "stated h (m)",
    "error/sigma n, e, d",
    "in its stretch",
    "outcome",
)
INTRODUCTION = f"""# Faults

What AutoMap makes of a recording in which one thing is wrong. Each fault below is put into recorded
drives that have a truth, everything else staying as it was recorded; `automap run` makes the path,
and the path is compared with the truth.

A run passes where one of these holds:

- the errors over the stated sigmas have an RMS of at most {MOST_SIGMA:.0f} on each of north, east
  and down over the whole drive;
- the [verdict](outputs.md#the-verdict) of the run is `doubtful` or `unusable`, for a reason that is
  about this fault: its code or its first clause names what was changed, or says that the path and
  its fixes contradict each other; where a reason tells seconds, the fault lies in them;
- the drive is refused with exit code 3 and a sentence that names the file.

Drives as they were recorded stand first. They pass only where the verdict is not `doubtful` and the
errors are within the sigmas: a verdict that always warns says nothing. The outcome of a fault says
whether it was told, not told, or told for another reason, and the stated sigma stands beside
the error: a path can pass because its sigma is large. Beside the errors over the whole drive stand
those in the fault's own stretch. Faults that no reading can show, as a position 10 m off all
the way, are listed as `beyond` and not counted.

| drive | what it is |
|---|---|
| `gsdc-mtv1` | a phone's NMEA at 1 Hz, real fixes, seven minutes of street and motorway |
| `kitti-20111003-0034` | NMEA at 5 Hz with arrival times, eight minutes of town |
| `kitti-20110930-0033` | UBX at 5 Hz with arrival times, three minutes of town |
| `rtk-car-a` | every fourth RTK fix, a usual receiver's errors added; coarse IMU, axes unknown |

Of `rtk-car-a` all fixes that RTK had fixed are the truth.

`python tests/benchmarks/fault_table.py --docs` runs them all and writes this page.
"""


def in_order(rows: Sequence[Row]) -> list[Row]:
    """By drive, then by the catalogue."""
    drives, faults = list(DRIVES), list(FAULTS)
    return sorted(rows, key=lambda r: (drives.index(r.drive), faults.index(r.fault)))


def cells_of(row: Row) -> tuple[str, ...]:
    """A line's cells in the order of HEAD."""
    codes = ", ".join(dict.fromkeys(reason.code for reason in row.reasons))
    whole, (result, how) = row.whole, outcome(row)
    errors = "-" if whole is None else f"{_m(whole.horizontal_m)}, {_m(whole.vertical_m)}"
    return (
        row.drive,
        row.fault,
        str(row.code),
        f"{row.state}: {codes}" if codes else row.state,
        errors,
        "-" if whole is None else _m(whole.stated_m),
        _ratios(whole),
        _ratios(row.stretch),
        f"{result}: {'cannot be seen' if result == 'beyond' else how}",
    )


def _m(value: float) -> str:
    return f"{value:.2f}" if value < 100.0 else f"{value:.4g}"


def _ratios(errors: Errors | None) -> str:
    if errors is None:
        return "-"
    return ", ".join(f"{r:.1f}" if r < 1000.0 else f"{r:.2g}" for r in errors.ratio)


def summary(rows: Sequence[Row]) -> list[str]:
    """A sentence each on controls and faults."""
    lines = []
    for title, part in (
        ("drives as recorded", [r for r in rows if r.fault == CONTROL]),
        ("faults", [r for r in rows if r.fault != CONTROL]),
    ):
        results = [outcome(row)[0] for row in part]
        count = {o: results.count(o) for o in ("passed", "failed", "beyond")}
        seen = count["passed"] + count["failed"]
        ways = Counter(how for how in map(outcome, part) if how[0] != "beyond")
        told = ", ".join(f"{n} {how}" for (_, how), n in ways.most_common())
        lines.append(
            f"{title}: {count['passed']} of {seen} passed ({told})"
            + (f", {count['beyond']} that cannot be seen from within" if count["beyond"] else "")
        )
    return lines


def markdown(rows: Sequence[Row], skipped: Sequence[tuple[str, str, str]]) -> str:
    """The table, the summary and what did not apply."""
    lines = [f"{line[0].upper()}{line[1:]}." for line in summary(rows)]
    lines += ["", "| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    for row in in_order(rows):
        cells = [cell.replace("|", "/").replace("\n", " ") for cell in cells_of(row)]
        lines.append("| " + " | ".join(cells) + " |")
    if skipped:
        lines += ["", "Not run: " + "; ".join(f"{f} on {d} ({w})" for d, f, w in skipped) + "."]
    return "\n".join(lines) + "\n"


def page(rows: Sequence[Row], skipped: Sequence[tuple[str, str, str]], version: str) -> str:
    """The page of the documentation; ``version`` the digest of the code that ran."""
    what = ["## What is put in", "", "| fault | what |", "|---|---|"]
    for fault in FAULTS.values():
        note = f" (nothing in the recording shows it: {fault.beyond})" if fault.beyond else ""
        what.append(f"| {fault.name} | {fault.what}{note} |")
    made = f"Made with the code whose digest (`code_version` of the benchmarks) is `{version}`."
    result = ["", "## What comes out", "", made, "", markdown(rows, skipped)]
    return INTRODUCTION + "\n" + "\n".join(what) + "\n" + "\n".join(result)
