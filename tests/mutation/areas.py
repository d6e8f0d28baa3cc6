"""What is mutated, and the test files that may notice."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]

AREAS: dict[str, tuple[str, ...]] = {
    "fusion": ("automap/fusion",),
    "effects": ("automap/effects",),
    "sync": ("automap/sync",),
    "calibration": ("automap/calibration",),
    "geolocation": ("automap/geolocation",),
    "mapping": ("automap/mapping", "automap/review"),
    "gap": ("automap/gap/evidence.py", "automap/gap/noise.py", "automap/gap/scoring.py"),
    "cache": ("pipeline/run/cache.py", "pipeline/run/digests.py", "automap/jit.py"),
}
"""Of each area its sources, folders or files."""

_IDLE = ("__init__.py",)
_IMPORT = re.compile(r"^\s*from ((?:automap|pipeline|tests)[\w.]*) import (\([^)]*\)|.*)", re.M)


def sources_of(area: str, root: Path = PROJECT) -> list[Path]:
    """The sources of an area, from the folder of a checkout."""
    found: list[Path] = []
    for name in AREAS[area]:
        path = root / name
        found += sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [path.relative_to(root) for path in found if path.name not in _IDLE]


@cache
def imported(root: Path, source: Path) -> frozenset[Path]:
    """The project's modules that a source imports, anywhere in it."""
    modules: set[str] = set()
    for module, names in _IMPORT.findall((root / source).read_text(encoding="utf-8")):
        # a name may be a module of a package
        modules |= {module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))}
    places = (Path(*name.split(".")) for name in modules)
    files = (each for place in places for each in (place.with_suffix(".py"), place / "__init__.py"))
    return frozenset(file for file in files if (root / file).is_file())
