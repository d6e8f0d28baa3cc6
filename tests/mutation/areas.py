"""What is mutated, and the fast tests that are asked first."""

from __future__ import annotations

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
        (
            *("test_effects*", "test_camera.py", "test_user_effects", "test_made_up_effects"),
            *("test_gap_formulas", "test_gap_camera", "test_simulation_receivers"),
        ),
    ),
    "sync": (
        ("automap/sync",),
        ("test_sync_*", "test_clock_steadiness", "test_epoch_means", "test_even_stamps"),
    ),
    "calibration": (("automap/calibration",), ("test_calibration_*",)),
    "geolocation": (("automap/geolocation",), ("test_geolocation*",)),
    "mapping": (
        ("automap/mapping",),
        ("test_merge_*", "test_inventory", "test_road*", "test_view_review"),
    ),
    "gap": (
        *(("automap/gap/evidence.py", "automap/gap/noise.py", "automap/gap/scoring.py"),),
        (
            *("test_gap_evidence", "test_gap_noise", "test_gap_confirm", "test_gap_heldout"),
            *("test_gap_fitted", "test_gap_scoring"),
        ),
    ),
    "cache": (
        *(("pipeline/run/cache.py", "pipeline/run/digests.py", "automap/jit.py"),),
        *(("test_runner", "test_cache_inputs", "test_kernel_staleness"),),
    ),
}
"""Of each area its sources, folders or files, and the names of its own unit tests."""

EVERY = ("test_closed_forms", "test_figures")
"""Tests of all areas."""

_IDLE = ("__init__.py",)


def sources_of(area: str, root: Path = PROJECT) -> list[Path]:
    """The sources of an area, from the folder of a checkout."""
    found: list[Path] = []
    for name in AREAS[area][0]:
        path = root / name
        found += sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [path.relative_to(root) for path in found if path.name not in _IDLE]


def own_tests(area: str, root: Path = PROJECT) -> list[str]:
    """The unit tests of an area."""
    unit = root / "tests" / "unit"
    found = [p for pattern in (*AREAS[area][1], *EVERY) for p in sorted(unit.glob(_whole(pattern)))]
    return [str(path.relative_to(root)) for path in dict.fromkeys(found)]


def _whole(pattern: str) -> str:
    return pattern if pattern.endswith((".py", "*")) else f"{pattern}.py"
