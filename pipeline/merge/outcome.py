"""What a merge brought."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from automap.mapping.compare import Comparison
    from automap.mapping.merge import Merged
    from automap.records import Sign


@dataclass(frozen=True)
class MergeOutcome:
    """The map's ``signs``, all that was ``merged``, the ``comparison`` with an older map (None
    without one), ``files`` written, ``warnings``, and the one ``country`` that the drives name
    (None where they name none, or several)."""

    folder: Path
    signs: list[Sign]
    merged: Merged
    comparison: Comparison | None
    files: list[Path]
    warnings: list[str]
    seconds: float
    country: str | None = None
