"""The stages in the order in which they run; each module is imported when it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Sequence

from automap.errors import ConfigError
from pipeline.run.stage import Stage

ORDER = ("ingest", "sync", "fuse", "detect", "geolocate", "export", "report")


def load_stages(names: Sequence[str] = ORDER) -> list[Stage]:
    """The stages of the given names, in their order."""
    stages = []
    for name in names:
        stage = importlib.import_module(f"pipeline.run.stages.{name}").STAGE
        if not isinstance(stage, Stage) or stage.name != name:
            raise TypeError(f"pipeline.run.stages.{name} does not define the stage {name}")
        stages.append(stage)
    return stages


def select(
    only: str | None = None, first: str | None = None, last: str | None = None
) -> tuple[str, ...]:
    """Names of the stages to run: one, or a range with both ends included.

    Raises ConfigError for options that exclude each other or a range that is empty.
    """
    if only is not None:
        if first is not None or last is not None:
            raise ConfigError("--only cannot stand beside --from or --to; give one or the other")
        return (only,)
    start = ORDER.index(first) if first is not None else 0
    end = ORDER.index(last) + 1 if last is not None else len(ORDER)
    if start >= end:
        raise ConfigError(
            f"--from {first} comes after --to {last}; the order is {', '.join(ORDER)}"
        )
    return ORDER[start:end]
