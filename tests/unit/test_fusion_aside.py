"""A path put aside in a file is judged and widened as one in memory."""

from __future__ import annotations

import re
import resource
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
import pytest

from automap.errors import StageError
from automap.fusion import aside as aside_module
from automap.fusion.aside import put_aside, whole_trajectory
from automap.fusion.doubts.reason import Reason
from automap.fusion.widening import widen, widening
from automap.io.atomic import scratch_file
from automap.records import Trajectory
from tests.unit.test_fusion_doubted_sigmas import NONE, winding_path


def test_a_file_that_has_lost_its_end_is_no_path() -> None:
    path = winding_path()
    with TemporaryFile() as file:
        aside = put_aside([path], path.t_ns, file)
        file.truncate(file.seek(0, 2) - 8)
        with pytest.raises(OSError, match="Input/output"):
            list(aside.stretches())


def test_scratch_that_finds_no_room_is_told_by_its_folder(tmp_path: Path) -> None:
    path = winding_path()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def put() -> None:
        with scratch_file(tmp_path) as file:
            put_aside([path], path.t_ns, file)

    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(StageError, match=f"cannot write {re.escape(str(tmp_path))}: "):
            put()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    # what has a name speaks for itself
    with pytest.raises(FileNotFoundError), scratch_file(tmp_path):
        (tmp_path / "none").read_bytes()
    assert list(tmp_path.iterdir()) == []


def cut(path: Trajectory, *at: int) -> list[Trajectory]:
    names = [field.name for field in fields(Trajectory)]
    edges = (0, *at, len(path))
    return [Trajectory(*(getattr(path, name)[a:b] for name in names)) for a, b in pairwise(edges)]


def same(one: Trajectory, other: Trajectory) -> bool:
    return all(np.array_equal(vars(one)[name], vars(other)[name]) for name in vars(one))


def test_what_is_put_aside_is_read_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aside_module, "ROWS", 70)
    path = winding_path()
    path = replace(path, slip_sd=0.1 * path.sd_rpy[:, 2])
    with TemporaryFile() as file:
        aside = put_aside(cut(path, 7, 300), path.t_ns, file)
        assert [rows for rows, _ in aside.stretches()][1] == slice(70, 140)
        for _ in range(2):
            assert same(whole_trajectory(part for _, part in aside.stretches()), path)
        motion = aside.motion()
        assert np.array_equal(aside.sd_roll(), path.sd_rpy[:, 0])
    sigmas = [name for name in vars(path) if "sd" in name.split("_")]
    assert same(replace(motion, **{name: vars(path)[name] for name in sigmas}), path)
    assert all(np.isnan(vars(motion)[name]).all() for name in sigmas)


def test_stretches_are_widened_like_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aside_module, "ROWS", 70)
    path = winding_path()
    other = replace(path, vel_ned=path.vel_ned + 0.7)
    reasons = [Reason("a", "", ((2.0, 90.0),), error_m=3.0), Reason("b", "", late_s=0.8)]
    whole = widen(path, reasons, NONE, other)
    part = widening(path, reasons, NONE, other)
    with TemporaryFile() as file:
        aside = put_aside(cut(path, 40, 300), path.t_ns, file)
        joined = whole_trajectory(part(stretch, rows) for rows, stretch in aside.stretches())
    for name, values in vars(whole).items():
        assert vars(joined)[name] == pytest.approx(values, rel=1e-12, abs=1e-12, nan_ok=True), name
    assert whole.sd_pos_ned.max() > 2.0 * path.sd_pos_ned.max()
