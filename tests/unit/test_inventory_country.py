"""The country whose signs a list has, where the drives name none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.inventory.country import country_of_classes, country_of_list
from automap.signs.classes import country_set, load_classes
from pipeline.compare.listing import no_country

COMMON = ["regulatory--stop--g1", "regulatory--yield--g1", "regulatory--no-entry--g1"]


@pytest.mark.parametrize("country", ["DE", "AU"])
def test_a_list_is_of_the_country_whose_signs_it_has(country: str) -> None:
    names = sorted(country_set(country))
    lists = [np.random.default_rng(k).choice(names, 130).tolist() for k in range(20)]
    told = [country_of_classes(names) for names in lists]
    assert set(told) <= {country, None}
    assert told.count(country) >= 18


def test_signs_of_all_countries_and_such_as_all_have_tell_none() -> None:
    assert country_of_classes([]) is None
    assert country_of_classes(COMMON * 50) is None
    assert country_of_classes(["", "no-class-of-ours"]) is None
    names = list(load_classes())
    lists = [np.random.default_rng(k).choice(names, 130).tolist() for k in range(20)]
    assert not any(country_of_classes(names) for names in lists)


def test_one_strange_entry_among_many_is_a_mistake() -> None:
    assert country_of_classes([*sorted(country_set("DE")), "warning--road-bump--g2"]) == "DE"


def test_codes_say_whose_they_are() -> None:
    """Whichever classes they have: signs of the Convention stand in many countries."""
    signs = ["information--parking--g1", "information--hospital--g1"]
    assert country_of_list(["AU:R4-1[50]", "au:W6-3", "VIENNA:E14A", "VIENNA:E13A"], signs) == "AU"
    assert country_of_list(["274-60", "Zeichen 206", "101"], COMMON) == "DE"
    assert country_of_list(["R4-1(60)", "G9-9", "stop"], COMMON) == "AU"
    assert country_of_list(["AU:R4-1[50]", "DE:206"], COMMON) is None
    assert country_of_list(["stop", ""], COMMON) is None


def test_a_country_that_no_drive_names_is_told_to_be_named() -> None:
    assert no_country(Path("city"), None) == []
    # of no set of its own: nothing would be read otherwise
    assert no_country(Path("city"), "US") == []
    assert 'country = "DE"' in no_country(Path("city"), "DE")[0]
