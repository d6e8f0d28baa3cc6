"""Columns of text: the digits of the kernels against Python's own."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from automap.export.csv_text import csv_cell
from automap.export.text_columns import (
    constant,
    fixed_column,
    integer_column,
    line_chunks,
    lines,
    ring_column,
    significant_column,
    special_characters,
    text_column,
)

NUMBERS = st.lists(
    st.floats(allow_nan=True, allow_infinity=True, width=64), min_size=1, max_size=20
)


@given(NUMBERS, st.integers(0, 9))
def test_fixed_decimals_are_those_of_python(values: list[float], decimals: int) -> None:
    texts = fixed_column(np.array(values), decimals, missing="null").texts()
    for value, text in zip(values, texts, strict=True):
        if not np.isfinite(value):
            assert text == "null"
            continue
        expected = f"{value:.{decimals}f}"
        nothing = f"{-0.0:.{decimals}f}"
        assert text == (nothing.lstrip("-") if expected == nothing else expected)


@given(st.lists(st.integers(0, 8 * 10**15), min_size=1, max_size=20), st.integers(0, 9))
# the product with 1e7 is rounded from .48 to a half
@example([281474976933431], 7)
def test_the_last_decimal_of_what_lies_beside_a_half(places: list[int], decimals: int) -> None:
    halves = [(place + 0.5) / 10**decimals for place in places]
    values = [v for half in halves for v in (half, *np.nextafter(half, [0.0, np.inf]).tolist())]
    values.append(28147497.693343148)
    texts = fixed_column(np.array(values), decimals).texts()
    assert texts == [f"{value:.{decimals}f}" for value in values]


@given(NUMBERS, st.integers(2, 9))
def test_significant_digits_are_those_of_python(values: list[float], digits: int) -> None:
    texts = significant_column(np.array(values), digits, missing="").texts()
    for value, text in zip(values, texts, strict=True):
        if not np.isfinite(value):
            assert text == ""
            continue
        json.loads(text)
        expected = float(f"{value:.{digits}g}")
        assert float(text) == pytest.approx(expected, rel=1.01 * 10.0 ** (1 - digits), abs=0)
        assert len(text) <= len(f"{value:.{digits}g}") + 1


def test_common_numbers_are_written_as_everywhere() -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(0, 1, 3000) * 10.0 ** rng.integers(-8, 8, 3000)
    assert significant_column(values).texts() == [f"{value:.6g}" for value in values]
    for decimals in (0, 2, 7):
        zero = f"{-0.0:.{decimals}f}"
        expected = [f"{value:.{decimals}f}" for value in values]
        expected = [zero.lstrip("-") if text == zero else text for text in expected]
        assert fixed_column(values, decimals).texts() == expected


@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=20))
def test_integers(values: list[int]) -> None:
    assert integer_column(np.array(values, np.int64)).texts() == [str(value) for value in values]


@given(st.lists(st.text(), max_size=20))
def test_texts_are_converted_wherever_they_need_it(values: list[str]) -> None:
    special = special_characters('"\\')
    column = text_column(values, json.dumps, special=special, quote='"')
    assert [json.loads(text) for text in column.texts()] == values


def test_rows_are_joined_in_their_order_over_many_chunks() -> None:
    n = 10_000
    numbers = np.arange(n) / 7.0
    keep = np.arange(n) % 3 == 0
    pieces = ["<", "a>", fixed_column(numbers, 3), constant("?", n).where(keep), "\n"]
    expected = "".join(
        f"<a>{value:.3f}{'?' if kept else ''}\n"
        for value, kept in zip(numbers.tolist(), keep.tolist(), strict=True)
    )
    assert lines(pieces, n).decode() == expected
    assert len(list(line_chunks(pieces, n))) > 1
    assert lines(pieces, 0) == b""


def test_rings() -> None:
    rings = np.array([[[149.1, -35.2], [-179.9999999, 0.00000004]]])
    assert ring_column(rings).texts() == ["149.1000000,-35.2000000 -179.9999999,0.0000000"]


@given(st.text())
def test_cells_of_a_spreadsheet_come_back(text: str) -> None:
    cell = csv_cell(text)
    assert csv_cell(cell, back=True) == text
    assert not cell.startswith(("=", "+", "-", "@"))
