"""What is mutated, and the fast tests that are asked first."""

from __future__ import annotations

import re
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]

AREAS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "fusion": (
        ("automap/fusion",),
        (
            *("test_fusion_*", "test_optimal_smoother", "test_standstill_positions"),
            *("test_steady_rate", "test_stuck_readings", "test_velocity_consistency"),
        ),
    ),
    "effects": (
        ("automap/effects",),
        ("test_effects*", "test_camera.py", "test_user_effects", "test_made_up_effects"),
    ),
    "sync": (
        ("automap/sync",),
        ("test_sync_*", "test_clock_steadiness", "test_epoch_means", "test_even_stamps"),
    ),
    "calibration": (("automap/calibration",), ("test_calibration_*",)),
    "geolocation": (("automap/geolocation",), ("test_geolocation_*",)),
    "mapping": (("automap/mapping",), ("test_merge_*", "test_inventory", "test_roads")),
    "gap": (
        *(("automap/gap/evidence.py", "automap/gap/noise.py", "automap/gap/scoring.py"),),
        *(("test_gap_evidence", "test_gap_noise", "test_gap_confirm", "test_gap_heldout"),),
    ),
    "cache": (
        *(("pipeline/run/cache.py", "pipeline/run/digests.py", "automap/jit.py"),),
        *(("test_runner", "test_cache_inputs", "test_kernel_staleness"),),
    ),
}
"""Of each area its sources, folders or files, and the names of its own unit tests."""

_IDLE = ("__init__.py",)


def sources_of(area: str, root: Path = PROJECT) -> list[Path]:
    """The sources of an area, from the folder of a checkout."""
    found: list[Path] = []
    for name in AREAS[area][0]:
        path = root / name
        found += sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [path.relative_to(root) for path in found if path.name not in _IDLE]


def tests_of(area: str, source: Path, root: Path) -> list[str]:
    """The unit tests that may notice a mistake: those that import the module itself, then the
    area's own."""
    module = ".".join(source.with_suffix("").parts)
    parent, _, name = module.rpartition(".")
    imports = re.compile(
        rf"^\s*(?:from {re.escape(module)} import|import {re.escape(module)}\b"
        rf"|from {re.escape(parent)} import .*\b{name}\b)",
        re.MULTILINE,
    )
    unit = sorted((root / "tests" / "unit").glob("test_*.py"))
    direct = [str(p.relative_to(root)) for p in unit if imports.search(p.read_text())]
    own = own_tests(area, root)
    return list(dict.fromkeys([*(test for test in own if test in direct), *direct, *own]))


def own_tests(area: str, root: Path = PROJECT) -> list[str]:
    """The unit tests of an area."""
    unit = root / "tests" / "unit"
    found = [p for pattern in AREAS[area][1] for p in sorted(unit.glob(_whole(pattern)))]
    return [str(path.relative_to(root)) for path in dict.fromkeys(found)]


def _whole(pattern: str) -> str:
    return pattern if pattern.endswith((".py", "*")) else f"{pattern}.py"
