"""Signs that a list lacks, on a map that geolocation made: each stage alone keeps its own figures,
and what one takes off the belief in a sign the next may need."""

from __future__ import annotations

import pytest

from automap.inventory.comparison import compare_inventory
from tests.benchmarks.inventory_world import case
from tests.unit.inventory_case import correct, due

pytestmark = pytest.mark.slow


def test_signs_that_a_list_lacks_are_for_work_after_one_drive() -> None:
    one = case(1131, 1)
    assert sum(sign.existence > 0.99 for sign in one.signs) > 0.9 * len(one.signs)
    result = compare_inventory(one.signs, one.faulty.inventory, one.drives)
    told = [f for f in result.findings if f.kind == "new" and f.sure]
    assert all(correct(f, one.faulty, one.truth) for f in told)
    # those beside another sign may be taken for it
    assert len(told) >= 0.8 * due(result, one.faulty, one.truth, "new") > 0.0
