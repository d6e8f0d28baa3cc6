"""Which tests a mistake is asked: quick ones of its area first, what several share counts once."""

from __future__ import annotations

import json
from pathlib import Path

from tests.mutation.asked import MOST_S, Calls
from tests.mutation.graph import callers_of, functions_of, kernels_from
from tests.mutation.mutants import mutants_of

SOURCE = Path("automap/a.py")
PLACE = f"{SOURCE}:f"


def told(seconds: float, **shared: float) -> dict[str, object]:
    return {"seconds": seconds, "shared": shared, "calls": [PLACE]}


def test_what_is_shared_counts_once_and_its_tests_stay_together(tmp_path: Path) -> None:
    files = {
        "tests/a.py": {"a1": told(0.5, run=8.0), "a2": told(0.3, run=8.0), "a3": told(0.1)},
        "tests/b.py": {"b1": told(0.4), "b2": told(1.0, drive=3.0), "b3": told(MOST_S + 1.0)},
        "tests/c.py": {"c1": told(0.6)},
    }
    (tmp_path / "tests").mkdir()
    (tmp_path / "automap").mkdir()
    (tmp_path / SOURCE).touch()
    for name in files:
        (tmp_path / name).write_text("from automap.a import f\n" if "c" in Path(name).stem else "")
    lines = [json.dumps({"file": name, "tests": tests}) for name, tests in files.items()]
    path = tmp_path / "calls.jsonl"
    path.write_text("\n".join(lines))
    kept = Calls(path)

    def asked(seconds: float, *only: str) -> list[str]:
        return [each.test for each in kept.tests_of({PLACE}, SOURCE, tmp_path, seconds, only)]

    # 0.6 + 0.1 + 0.4 + 1 + 3 + 0.3 + 0.5 + 8 s
    assert asked(14.0) == ["c1", "a3", "b1", "b2", "a2", "a1"]
    assert asked(13.5) == ["c1", "a3", "b1", "b2", "a2"]
    assert asked(14.0, "tests/b.py") == ["b1", "b2"]
    assert not kept.tests_of({"automap/a.py:g"}, SOURCE, tmp_path, 14.0)


def test_what_kernels_are_compiled_into_is_found_in_the_sources() -> None:
    path = "automap/fusion/kernels/axis.py"
    changed = {f"{path}:_sandwich"}
    assert kernels_from(changed) == {
        f"{path}:{n}" for n in ("_sandwich", "_backward", "smooth_axis")
    }
    assert "automap/fusion/fix_axes.py:smooth_epochs" in callers_of(kernels_from(changed))
    line = next(
        n for n, s in enumerate(Path(path).read_text().splitlines(), 1) if "_sandwich(" in s
    )
    assert functions_of(Path(path), line + 2) <= {f"{path}:{n}" for n in ("_sandwich", "_backward")}


def test_a_mistake_leaves_all_else_on_its_line() -> None:
    source = "x = (\n    a\n    + b\n)\nf(\n    1,\n)\nlast = 2\n"
    for mutant in mutants_of(source):
        assert mutant.applied(source).count("\n") == source.count("\n")
