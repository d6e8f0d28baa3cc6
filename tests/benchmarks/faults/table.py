"""The table of all runs: for the terminal, and as a page of the documentation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from tests.benchmarks.faults.catalogue import CONTROL, FAULTS
from tests.benchmarks.faults.drives import DRIVES
from tests.benchmarks.faults.judge import AXES, MOST_SIGMA, Case, Errors, Row, fitting, outcome

HEAD = (
    "drive",
    "fault",
    "axes",
    "exit",
    "verdict",
    "error h, v (m)",
    "stated h (m)",
    "error/sigma n, e, d",
    "in its stretch",
    "outcome",
)
INTRODUCTION = f"""# Faults

What AutoMap makes of a recording in which one thing is wrong. Each fault below is put into drives
that have a truth, recorded ones and a simulated one, everything else staying as it was;
`automap run` makes the path, and the path is compared with the truth.

A run passes where one of these holds:

- the errors over the stated sigmas have an RMS of at most {MOST_SIGMA:.0f} on each of north, east
  and down over the whole drive and in the fault's own stretch;
- the [verdict](outputs.md#the-verdict) of the run is `doubtful` or `unusable`, for a reason that is
  about this fault: its code or its first clause names what was changed, or says that the path and
  its fixes contradict each other; where a reason tells seconds, the fault lies in them;
- the drive is refused with exit code 3 and a sentence that names the file.

Drives as they were recorded stand first. They pass only where the verdict is not `doubtful` and the
errors are within the sigmas: a verdict that always warns says nothing. Every fault is tried with
the IMU's axes as the manifest gives them and with `axes = "unknown"`.
"""
LEGEND = """Of `rtk-car-a` all fixes that RTK had fixed are the truth.

`python tests/benchmarks/fault_table.py --docs` runs them all and writes this page; a table with a
line for every run stands beside its results.

## What comes out

A number is the largest of north, east and down of the RMS of error over stated sigma; `told` where
the verdict names the fault, `other` where it warns of something else, a number alone where it is
silent. Two results are those with given / unknown axes. The largest stated horizontal sigma (RMS
over a drive) stands beside them: a path can pass because its sigma is large.
"""
Results = dict[Case, tuple[str, Row | str]]
"""By case the version of the code that ran, and the run, or why the fault does not apply."""


def cells_of(row: Row) -> tuple[str, ...]:
    """A line's cells in the order of HEAD."""
    codes = ", ".join(dict.fromkeys(reason.code for reason in row.reasons))
    whole, (result, how) = row.whole, outcome(row)
    errors = "-" if whole is None else f"{_m(whole.horizontal_m)}, {_m(whole.vertical_m)}"
    return (
        row.drive,
        row.fault,
        row.axes,
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


def details(results: Results) -> str:
    """A line for every run, the summary, and what did not apply."""
    rows, skipped = _parted(results)
    lines = [*summary(rows), "", "| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    for row in rows:
        cells = [cell.replace("|", "/").replace("\n", " ") for cell in cells_of(row)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", *skipped]) + "\n"


def page(results: Results) -> str:
    """The page of the documentation: a line for every fault."""
    rows, skipped = _parted(results)
    drives = [name for name in DRIVES if any(row.drive == name for row in rows)]
    lines = [INTRODUCTION, "| drive | what it is |", "|---|---|"]
    lines += [f"| `{name}` | {DRIVES[name].what} |" for name in drives]
    lines += ["", LEGEND, _versions(results), ""]
    lines += [f"{line[0].upper()}{line[1:]}." for line in summary(rows)]
    head = ["fault", "what", *(f"`{name}`" for name in drives), "most stated (m)", "told as"]
    lines += ["", "| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for fault in FAULTS.values():
        of_fault = [row for row in rows if row.fault == fault.name]
        cells = [fault.name, fault.what]
        cells += [_pair([r for r in of_fault if r.drive == name]) for name in drives]
        stated = [row.whole.stated_m for row in of_fault if row.whole]
        codes = sorted({code for row in of_fault for code in fitting(row)})
        cells += [_m(max(stated)) if stated else "-", ", ".join(codes)]
        lines.append("| " + " | ".join(cells) + " |")
    beyond = [f"{f.name}: {f.beyond}" for f in FAULTS.values() if f.beyond]
    lines += ["", "Nothing in the recording shows " + "; ".join(beyond) + "."]
    return "\n".join([*lines, "", *skipped]) + "\n"


def _parted(results: Results) -> tuple[list[Row], list[str]]:
    rows = [row for _, row in results.values() if not isinstance(row, str)]
    unlike: dict[str, str] = {}
    for (drive, fault, _), (_, why) in results.items():
        if isinstance(why, str):
            unlike[f"{fault} on {drive}"] = why
    told = "; ".join(f"{name} ({why})" for name, why in unlike.items())
    return rows, [f"Not run: {told}."] if told else []


def _versions(results: Results) -> str:
    """Which code ran, where it was not one all the time with its drives."""
    count: dict[str, Counter[str]] = {}
    for (drive, _, _), (version, row) in results.items():
        if not isinstance(row, str):
            count.setdefault(version, Counter())[drive] += 1
    told = "; ".join(
        f"`{version}` ({', '.join(f'{n} runs of `{d}`' for d, n in drives.items())})"
        for version, drives in sorted(count.items(), key=lambda item: -item[1].total())
    )
    return f"Made with the code whose digest (`code_version` of the benchmarks) is {told}."


def _pair(rows: Sequence[Row]) -> str:
    """What came of a fault on a drive, with given and with unknown axes."""
    cells = {row.axes: _short(row) for row in rows}
    if len(cells) < len(AXES):
        return next(iter(cells.values()), "-")
    given, unknown = (cells[axes] for axes in AXES)
    return given if given == unknown else f"{given} / {unknown}"


def _short(row: Row) -> str:
    if row.whole is None:
        return "refused" if outcome(row)[0] == "passed" else f"**exit {row.code}**"
    result, how = outcome(row)
    ratio = f"{max(row.whole.ratio):.1f}"
    if result == "failed":
        seconds = f" ({max(row.stretch.ratio):.1f})" if row.stretch else ""
        return f"**{ratio}{seconds} {how}**"
    if fitting(row):
        return f"{ratio} told"
    return ratio if "another" not in how else f"{ratio} other"
