"""Results that cannot be read: told and left out, or the stage fails where they may be sound."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import numpy as np
import pytest
from export_inputs import sign, write_run

from automap.errors import InputError, StageError
from automap.io import names
from automap.io.clock_json import write_clock
from automap.io.signs_table import read_signs, write_signs
from automap.io.trajectory_table import read_trajectory
from automap.records import ClockModel
from pipeline.export.command import export_run
from pipeline.merge.inputs import read_run
from pipeline.shared.products import load_products
from pipeline.view.drives import MapDrive


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


def test_signs_are_dated_by_the_clock_of_the_path(tmp_path: Path) -> None:
    """That of sync.json lacks the receiver's delay that the fusion found: signs and path of one
    run were dated apart by it, in every format, in merged maps and in the viewer."""
    out = write_run(tmp_path / "out", signs=3, seconds=20.0)
    path = read_trajectory(out / names.TRAJECTORY)
    late = ClockModel(int(path.t_ns[0]), float(path.gps_s[0]) - 0.4, 0.0, 1e-3, 1e-6, "arrival")
    write_clock(out / names.SYNC, late)
    products, seen = load_products(out), MapDrive("out", out, None)
    for clock in (products.clock, seen.clock):
        assert clock is not None
        assert np.abs(clock.gps_s(path.t_ns) - path.gps_s).max() < 1e-5
        stamps = np.array([s.first_seen_ns for s in products.signs or []])
        assert np.abs(clock.gps_s(stamps) - read_run(out).signs.first_gps_s).max() < 1e-5
    (out / names.TRAJECTORY).unlink()
    found = load_products(out).clock
    assert found is not None
    assert found.method == "arrival"


@pytest.mark.slow
def test_many_signs_of_few_drives_hold_their_names_once(tmp_path: Path) -> None:
    """Of ten million sightings the names of their drives would be half a gigabyte."""
    signs = [sign(k, drives=("monday", f"drive-{k % 2}")) for k in range(5000)]
    write_signs(tmp_path / names.SIGNS_RAW, signs)
    found = read_signs(tmp_path / names.SIGNS_RAW)
    assert [s.id for s in found] == [s.id for s in signs]
    assert len({id(name) for s in found for name in s.drives}) == 3
    assert len({id(s.class_name) for s in found}) == 3


def _recorded(out: Path) -> None:
    """The run's record names what it wrote, as that of a real run does."""
    record = json.loads((out / names.RUN).read_text())
    wrote = {n: {"bytes": (out / n).stat().st_size} for n in (names.SIGNS_RAW, names.TRAJECTORY)}
    record["stages"] = {"geolocate": {"status": "done", "outputs": wrote}}
    (out / names.RUN).write_text(json.dumps(record))


def test_what_its_run_wrote_and_is_not_there_any_more_is_told(tmp_path: Path) -> None:
    """A folder copied in part passed for a run that located nothing."""
    out = write_run(tmp_path / "out", signs=3, seconds=20.0)
    _recorded(out)
    assert not load_products(out).problems
    table = out / names.SIGNS_RAW
    content = table.read_bytes()
    write_signs(table, read_signs(table)[:2])
    assert any("changed after its run" in text for text in load_products(out).problems)
    assert any("changed after its run" in text for text in read_run(out).warnings)
    table.unlink()
    assert any("signs_raw.parquet is missing" in text for text in load_products(out).problems)
    for form in ("csv", "gpkg", "osm"):
        with pytest.raises(InputError, match="is missing, though its run wrote it"):
            export_run(out, form, tmp_path / "map")
        assert not (tmp_path / "map").exists()
    # what its signs are does not concern its path
    export_run(out, "tum", tmp_path / "path")
    table.write_bytes(content[:-40])
    with pytest.raises(InputError, match="cannot be read"):
        export_run(out, "csv", tmp_path / "map")
    table.write_bytes(content)
    (out / names.REVIEW).write_text('{"schema": "automap.review/2", "acti')
    with pytest.raises(InputError, match=r"review\.json cannot be read as a review"):
        export_run(out, "csv", tmp_path / "map")


def test_a_map_without_its_record_says_what_it_lacks(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=3, seconds=20.0)
    (out / names.RUN).unlink()
    _, warnings = export_run(out, "csv", tmp_path / "map.csv")
    assert any("run.json is missing, so the country" in text for text in warnings)


def test_a_byte_order_mark_is_no_damage(tmp_path: Path) -> None:
    """Editors on Windows put one before a file."""
    out = write_run(tmp_path / "out", signs=3, seconds=20.0)
    record = (out / names.RUN).read_text()
    (out / names.RUN).write_text(record, encoding="utf-8-sig")
    (out / names.REVIEW).write_text(
        '{"schema": "automap.review/2", "actions": []}', encoding="utf-8-sig"
    )
    assert not load_products(out).problems
