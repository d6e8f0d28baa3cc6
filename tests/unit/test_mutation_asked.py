"""Which tests a mistake is asked: the quickest, and a fixture that several share counts once."""

from __future__ import annotations

import json
from pathlib import Path

from tests.mutation.asked import COMPILED, Calls

PLACE = "automap/a.py:f"


def told(seconds: float, **shared: float) -> dict[str, object]:
    return {"seconds": seconds, "shared": shared, "calls": [PLACE]}


def calls(folder: Path, **files: dict[str, dict[str, object]]) -> Calls:
    path = folder / "calls.json"
    whole = {name: {"digest": "", "tests": tests} for name, tests in files.items()}
    path.write_text(json.dumps(whole))
    return Calls(path)


def test_a_shared_fixture_counts_once_and_its_tests_stay_together(tmp_path: Path) -> None:
    kept = calls(
        tmp_path,
        a={"a::1": told(0.5, run=8.0), "a::2": told(0.3, run=8.0), "a::3": told(0.1, other=0.01)},
        b={"b::1": told(0.4), "b::2": told(1.0, drive=3.0), "b::3": told(30.0)},
    )
    asked = [each.test for each in kept.tests_of({PLACE}, 14.0)]
    # 0.1 + 0.01 + 0.4 + 1 + 3 + 0.3 + 0.5 + 8 s
    assert asked == ["a::3", "b::1", "b::2", "a::2", "a::1"]
    assert [each.test for each in kept.tests_of({PLACE}, 13.0)] == ["a::3", "b::1", "b::2", "a::2"]
    assert [each.test for each in kept.tests_of({PLACE}, 14.0, ("b",))] == ["b::1", "b::2"]
    assert not kept.tests_of({"automap/a.py:g"}, 14.0)


def test_tests_of_whole_drives_are_asked_only_where_no_kernel_is(tmp_path: Path) -> None:
    kept = calls(tmp_path, **{COMPILED[0]: {"drive": told(1.0)}, "b": {"b": told(2.0)}})
    assert [each.test for each in kept.tests_of({PLACE}, 14.0)] == ["b"]
    assert [each.test for each in kept.tests_of({PLACE}, 14.0, compiled=True)] == ["drive", "b"]
