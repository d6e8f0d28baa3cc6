"""Results that cannot be read: told and left out, or the stage fails where they may be sound."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
from export_inputs import write_run

from automap.errors import StageError
from automap.io import names
from pipeline.shared.products import load_products


def test_a_damaged_file_is_left_out(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=3, seconds=20.0)
    (out / names.TRAJECTORY).write_bytes(b"no table")
    products = load_products(out).readable()
    assert products.trajectory is None
    assert any(names.TRAJECTORY in text for text in products.problems)


@pytest.mark.parametrize("number", [errno.EIO, errno.EMFILE, errno.ESTALE])
def test_a_file_that_the_system_refuses_is_no_missing_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refused(path: Path) -> None:
        raise OSError(number, "refused", str(path))

    out = write_run(tmp_path / "out", signs=3, seconds=20.0)
    monkeypatch.setattr("automap.io.signs_table.read_signs", refused)
    products = load_products(out)
    assert products.signs is None
    with pytest.raises(StageError, match=r"signs_raw.*cannot be read \(refused\)"):
        products.readable()
