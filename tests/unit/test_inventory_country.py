"""The country whose signs a list has, where the drives name none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.inventory.country import country_of_classes
from automap.signs.classes import country_set, load_classes
from automap.signs.codes import classes_of
from pipeline.compare.listing import no_country

COMMON = ["regulatory--stop--g1", "regulatory--yield--g1", "regulatory--no-entry--g1"]


@pytest.mark.parametrize("country", ["DE", "AU"])
def test_a_list_is_of_the_country_whose_signs_it_has(country: str) -> None:
    names = sorted(country_set(country))
    lists = [np.random.default_rng(k).choice(names, 40).tolist() for k in range(20)]
    told = [country_of_classes(names) for names in lists]
    assert set(told) <= {country, None}
    assert told.count(country) >= 18


def test_signs_of_all_countries_and_such_as_all_have_tell_none() -> None:
    assert country_of_classes([]) is None
    assert country_of_classes(COMMON * 50) is None
    assert country_of_classes(["", "no-class-of-ours"]) is None
    names = list(load_classes())
    lists = [np.random.default_rng(k).choice(names, 40).tolist() for k in range(20)]
    # of twenty that are sure to nine tenths, two may err
    assert sum(country_of_classes(names) is not None for names in lists) <= 2


def test_one_strange_entry_among_many_is_a_mistake() -> None:
    german = classes_of(["101", "103-10", "112", "114", "123", "136-10", "306", "274-60"], "DE")
    assert country_of_classes([*filter(None, german), "warning--road-bump--g2"]) == "DE"


def test_a_country_that_no_drive_names_is_told_to_be_named() -> None:
    assert no_country(Path("city"), None) == []
    # of no set of its own: nothing would be read otherwise
    assert no_country(Path("city"), "US") == []
    assert 'country = "DE"' in no_country(Path("city"), "DE")[0]
