"""The folder of a drive where its results are meant, and the other way round."""

from __future__ import annotations

from pathlib import Path

import pytest
from export_inputs import write_run

from automap.errors import InputError
from automap.io import names
from automap.io.manifest import read_manifest
from pipeline.evaluate.command import evaluate_run
from pipeline.export.command import export_run
from pipeline.merge.command import merge_runs
from pipeline.view.opening import open_map


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    folder = tmp_path / "monday"
    write_run(folder / names.DEFAULT_OUT, signs=3, seconds=20.0)
    (folder / names.MANIFEST).write_text('schema = "automap.drive/1"\n')
    return folder


def test_a_drive_stands_for_its_results(drive: Path, tmp_path: Path) -> None:
    """A drive that was run was told to be run first."""
    path, _ = export_run(drive, "csv")
    assert path.parent == drive / names.DEFAULT_OUT
    assert open_map(drive).signs is not None
    assert len(merge_runs([drive], tmp_path / "map").signs) == 3


def test_results_are_no_drive(drive: Path) -> None:
    with pytest.raises(InputError, match="holds results, no recordings; give the folder"):
        read_manifest(drive / names.DEFAULT_OUT / names.MANIFEST)


def test_what_is_no_drive_is_made_one_by_init(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="automap init"):
        read_manifest(tmp_path / names.MANIFEST)


def test_no_results_are_told_before_a_truth_is_missed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="neither a trajectory nor signs; run the drive first"):
        evaluate_run(tmp_path)
