"""Results do not move unnoticed: figures of short computations are those that were kept.

Where results are meant to move, ``python -m tests.unit.figures`` writes them anew, and
``CHANGELOG.md`` says by how much.
"""

from __future__ import annotations

import pytest

from tests.unit.figures import FOLDER, differences, figures_of, kept
from tests.unit.scenarios import SCENARIOS

SAME = 5e-5
"""Of a figure's size. Other processors and compilers change the eleventh digit; what iterates to a
tolerance ended 3e-6 of its size away on one."""


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_figures_are_those_that_were_kept(name: str) -> None:
    told = differences(figures_of(SCENARIOS[name]()), kept(name), SAME)
    assert not told, f"{name}: {len(told)} figures moved, {sorted(told)[:5]}"


def test_every_file_of_figures_has_its_scenario() -> None:
    assert {path.stem for path in FOLDER.glob("*.json")} == SCENARIOS.keys()


@pytest.mark.parametrize("rows", [2, 7, 40])
def test_figures_tell_signs_order_and_digits(rows: int) -> None:
    values = [0.3 * k**2 - 1.0 for k in range(rows)]
    whole = figures_of({"a": values})
    assert not differences(figures_of({"a": values}), whole, SAME)
    swapped = [values[1], values[0], *values[2:]]
    turned = [-values[0], *values[1:]]
    moved = [*values[:-1], values[-1] * (1.0 + 1e-3)]
    for other in (swapped, turned, moved, values[:-1], [float("nan"), *values[1:]]):
        assert differences(figures_of({"a": other}), whole, SAME)
    assert differences(figures_of({"b": values}), whole, SAME)
