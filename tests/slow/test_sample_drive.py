"""The whole sample drive, video and all, gives what it should."""

from __future__ import annotations

from pathlib import Path

import pytest

from automap.io import names
from tests.sample_figures import compare, run_sample


@pytest.mark.slow
def test_the_map_has_the_stored_figures(tmp_path: Path) -> None:
    figures = run_sample(tmp_path)
    assert compare(figures, "trajectory") == []
    assert compare(figures, "signs") == []
    for name in (names.REPORT, names.KML, names.GPKG, names.SIGNS_GEOJSON, names.SIGNS_TABLE):
        assert (tmp_path / "out" / name).stat().st_size > 1000
