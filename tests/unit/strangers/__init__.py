"""Tables as strangers write them: the sample drive in some fifty layouts, and what they tell."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.unit.strangers import languages, layouts, phones, places, times, units
from tests.unit.strangers.drive import Truth

WRITERS: tuple[Callable[[Path], Truth], ...] = (
    *languages.WRITERS,
    *places.WRITERS,
    *times.WRITERS,
    *units.WRITERS,
    *layouts.WRITERS,
    *phones.WRITERS,
)
