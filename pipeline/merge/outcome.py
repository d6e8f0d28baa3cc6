"""What a merge brought."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from automap.mapping.compare import Comparison
    from automap.mapping.merge import Merged
    from automap.records import Sign


@dataclass(frozen=True, kw_only=True)
class MapOutcome:
    """The map's ``signs``, the ``comparison`` with an older map (None without one), ``warnings``,
    the ``name`` of the map, the one ``country`` that the drives name (None where they name
    none, or several), a layer of ``roads`` and a ``background`` of the report (None without)."""

    name: str
    signs: Sequence[Sign]
    comparison: Comparison | None
    warnings: list[str]
    country: str | None = None
    roads: Path | None = None
    background: Path | None = None


@dataclass(frozen=True, kw_only=True)
class MergeOutcome(MapOutcome):
    """With the ``folder``, all that was ``merged``, the ``files`` written, and the ``summary`` that
    is merge.json."""

    folder: Path
    merged: Merged
    files: list[Path]
    summary: dict[str, Any]
    seconds: float
