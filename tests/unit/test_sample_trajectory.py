"""The sample drive's trajectory is as good as it was: ingest, sync and fuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.sample_figures import compare, run_sample, stored


def test_the_trajectory_has_the_stored_figures(tmp_path: Path) -> None:
    figures = run_sample(tmp_path, "--to", "fuse")
    assert compare(figures, "trajectory") == []


def test_a_figure_that_is_off_is_told() -> None:
    rows = stored("trajectory")
    figures: dict[str, Any] = {}
    for row in rows:
        inner = figures
        *path, last = row["figure"].split(".")
        for key in path:
            inner = inner.setdefault(key, {})
        inner[last] = row["value"] + 1.01 * row["tolerance"] + 1e-6
    assert len(compare(figures, "trajectory")) == len(rows)
