"""Which tests are asked of a mistake, and how sources tell."""

from __future__ import annotations

from pathlib import Path

from tests.mutation.asked import MOST_S, QUICK_S, Seconds, asked
from tests.mutation.graph import functions_of, kernels_from, reaching
from tests.mutation.mutants import mutants_of


def test_the_nearest_are_asked_first_and_the_dear_ones_last_or_never() -> None:
    near = {"a::1": 1, "a::2": 2, "a::3": 1, "b::1": 3, "b::2": 1}
    seconds = {"a::1": QUICK_S + 1.0, "a::2": 0.2, "a::3": 0.1, "b::2": MOST_S + 1.0}
    assert [test for test, _ in asked(near, seconds)] == ["a::3", "a::2", "b::1", "a::1"]
    assert asked(near, seconds, ("b",)) == [("b::1", 0.0)]


def test_what_tests_take_is_learnt_once(tmp_path: Path) -> None:
    Seconds(tmp_path / "kept").learn({"a": 1.0})
    Seconds(tmp_path / "kept").learn({"a": 2.0, "b": float("inf")})
    assert Seconds(tmp_path / "kept").of == {"a": 1.0, "b": float("inf")}


def test_what_kernels_are_compiled_into_is_found_in_the_sources() -> None:
    path = "automap/fusion/kernels/axis.py"
    changed = {f"{path}:_sandwich"}
    assert kernels_from(changed) == {
        f"{path}:{n}" for n in ("_sandwich", "_backward", "smooth_axis")
    }
    near = reaching(changed)
    own = "the_smoother_of_an_axis_is_the_conditional_mean_of_all_states_at_once"
    assert near[f"tests/unit/test_fusion_closed_forms.py::test_{own}"] == 2
    line = next(
        n for n, s in enumerate(Path(path).read_text().splitlines(), 1) if "_sandwich(" in s
    )
    assert functions_of(Path(path), line + 2) <= {f"{path}:{n}" for n in ("_sandwich", "_backward")}


def test_a_mistake_leaves_all_else_on_its_line() -> None:
    source = "x = (\n    a\n    + b\n)\nf(\n    1,\n)\nlast = 2\n"
    for mutant in mutants_of(source):
        assert mutant.applied(source).count("\n") == source.count("\n")
