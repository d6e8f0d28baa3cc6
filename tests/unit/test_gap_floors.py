"""The picture of the gap finder in its documentation is the one that the code has."""

from __future__ import annotations

import re
from pathlib import Path

from tests.unit.test_layers import ROOT, imports

PACKAGE = "automap.gap"
TEXT = (ROOT / "docs" / "gap.md").read_text(encoding="utf-8")
DIAGRAM = re.compile(r"^```text\n(.*?)^```", re.MULTILINE | re.DOTALL)
FLOOR = re.compile(r"^\| (\d+) \| (.*) \|$", re.MULTILINE)
MOST_FLOORS = 8


def modules(folder: Path) -> set[str]:
    return {path.stem for path in folder.glob("*.py")} - {"__init__"}


def floors() -> dict[str, int]:
    """Floor of each module as the documentation has it."""
    rows = FLOOR.findall(TEXT)
    return {name: int(floor) for floor, row in rows for name in re.findall(r"`(\w+)`", row)}


def test_the_diagram_names_modules_that_there_are() -> None:
    found = DIAGRAM.search(TEXT)
    assert found is not None
    # behind the drawing, after a gap; a v is the head of an arrow
    lists = re.findall(r"   ((?:\w+, )*\w+)$", found.group(1), re.MULTILINE)
    named = {name for row in lists for name in row.split(", ")} - {"v"}
    assert len(named) > 10
    assert named <= modules(ROOT / "automap" / "gap")


def test_every_module_stands_on_the_floor_that_the_table_says() -> None:
    told = floors()
    assert set(told) == modules(ROOT / "automap" / "gap")
    assert max(told.values()) <= MOST_FLOORS
    wrong = [
        f"{source} (floor {told[source]}) imports {target} (floor {told[target]})"
        for source, target in (
            (a.source.removeprefix(f"{PACKAGE}."), a.target.removeprefix(f"{PACKAGE}."))
            for a in imports(ROOT)
        )
        if source in told and target in told and told[target] >= told[source]
    ]
    assert wrong == []


def test_nothing_but_the_entry_knows_the_cameras() -> None:
    assert {
        a.source
        for a in imports(ROOT)
        if a.target.startswith(f"{PACKAGE}.camera.")
        and a.source.startswith(f"{PACKAGE}.")
        and not a.source.startswith(f"{PACKAGE}.camera.")
    } == {f"{PACKAGE}.finder"}


def test_cameras_are_searched_by_the_modules_that_are_listed() -> None:
    listed = re.search(r"`automap/gap/camera`[^:]*: ([^.]*)\.", TEXT)
    assert listed is not None
    assert set(re.findall(r"`(\w+)`", listed.group(1))) == modules(
        ROOT / "automap" / "gap" / "camera"
    )
