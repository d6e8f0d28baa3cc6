"""Cases of a test of which the first few run each time and the others with the slow ones."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def others_slow(values: Iterable[Any], fast: int = 1) -> list[Any]:
    """``values`` for ``pytest.mark.parametrize``: all after the first ``fast`` marked slow."""
    return [
        value if i < fast else pytest.param(*_parts(value), marks=pytest.mark.slow)
        for i, value in enumerate(values)
    ]


def _parts(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)
