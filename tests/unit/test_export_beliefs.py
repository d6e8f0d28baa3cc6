"""Probabilities as people read them."""

from __future__ import annotations

import pytest

from automap.export.beliefs import belief_text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (0.796, "0.80"), (0.9949, "0.99"), (0.9996, "over 0.99"), (1.0, "over 0.99")],
)
def test_nothing_is_called_certain(value: float, text: str) -> None:
    assert belief_text(value) == text
