"""Which tests are asked of a mistake, and how sources tell."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.mutation import graph
from tests.mutation.areas import imported
from tests.mutation.asked import MOST_S, QUICK_S, Seconds, asked
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


SOURCES = {
    "automap/low.py": "LIMIT = 2\n@kernel\ndef leaf(x):\n    return x + LIMIT\n",
    "automap/mid.py": "from automap.low import leaf\n@kernel\ndef tree(x):\n    return leaf(x)\n",
    "automap/front.py": "from automap.mid import tree\n",
    "automap/top.py": "from automap.front import tree\ndef run():\n    return tree(1)\n",
    "automap/alien.py": "def tree():\n    pass\ndef alone():\n    tree()\n",
    "tests/conftest.py": "",
    "tests/unit/test_top.py": "from automap.top import run\ndef test_run():\n    run()\n",
    "tests/unit/test_low.py": "from automap.low import leaf\ndef test_leaf():\n    leaf(1)\n",
    "tests/unit/scenarios.py": (
        "from automap.low import leaf\n@scenario\ndef short():\n    leaf(1)\n"
        "def other():\n    leaf(1)\n"
    ),
    "tests/unit/test_alien.py": "from automap.alien import alone\ndef test_it():\n    alone()\n",
}


def test_what_is_compiled_from_a_line_and_what_tests_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in SOURCES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(graph, "PROJECT", tmp_path)
    kept = [f for f in vars(graph).values() if hasattr(f, "cache_clear") and f is not imported]
    try:
        for function in kept:
            function.cache_clear()
        for line in (1, 4):  # of a constant those that use it
            changed = graph.functions_of(Path("automap/low.py"), line)
            assert changed == {"automap/low.py:leaf"}
        assert graph.kernels_from(changed) == {"automap/low.py:leaf", "automap/mid.py:tree"}
        tests = {
            "tests/unit/test_low.py::test_leaf": 1,
            "tests/unit/test_top.py::test_run": 3,
            # a scenario stands for the test that keeps its figures
            "tests/unit/test_figures.py::test_figures_are_those_that_were_kept[short]": 1,
        }
        assert graph.reaching(changed) == tests
    finally:
        for function in kept:
            function.cache_clear()


def test_a_mistake_leaves_all_else_on_its_line() -> None:
    source = "x = (\n    a\n    + b\n)\nf(\n    1,\n)\nlast = 2\n"
    for mutant in mutants_of(source):
        assert mutant.applied(source).count("\n") == source.count("\n")
