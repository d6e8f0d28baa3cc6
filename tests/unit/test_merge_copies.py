"""Runs of one recording in one merge, and what reviewers of single drives decided."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from export_inputs import sign as made_sign
from merge_folders import passes, review, write_run

from automap.records import NO_TIME
from pipeline.merge.command import merge_runs
from pipeline.merge.distinct import candidate, distinct
from pipeline.merge.doubles import Marks
from pipeline.merge.inputs import read_run
from pipeline.merge.seen_again import since_reviewed


def test_two_runs_of_one_recording_count_once(tmp_path: Path) -> None:
    drive = passes(1)[0]
    runs = [write_run(tmp_path / name, drive, "same digest") for name in ("a", "b")]
    outcome = merge_runs(runs, tmp_path / "map")
    assert len(outcome.merged.drives) == 1
    assert any("another run" in text for text in outcome.warnings)


def judged(run: Path, state: str) -> None:
    record = json.loads((run / "run.json").read_text(encoding="utf-8"))
    record["verdict"] = {"state": state, "reasons": [{"text": f"it is {state}."}]}
    (run / "run.json").write_text(json.dumps(record), encoding="utf-8")


def counted(runs: list[Path]) -> tuple[Path, str]:
    """The run of two that counts, whatever their order, and what is said of the other."""
    read = [read_run(run) for run in runs]
    found = [distinct([r.candidate for r in some], "another run of") for some in (read, read[::-1])]
    (((one,), (told,)), ((other,), (again,))) = found
    assert (told, runs[one]) == (again, runs[::-1][other])
    assert str(runs[1 - one]) in told.split(" is ")[0]
    return runs[one], told


def test_of_runs_of_one_drive_the_reviewed_one_counts_then_the_better(tmp_path: Path) -> None:
    drive = passes(1)[0]
    runs = [write_run(tmp_path / name, drive, "same digest") for name in "ab"]
    a, b = runs
    judged(a, "doubtful")
    judged(b, "good")
    kept, told = counted(runs)
    assert kept == b
    assert "better verdict (good, not doubtful)" in told
    judged(a, "unusable")
    review(a, "2026-11-23T10:00:00Z")
    kept, told = counted(runs)
    assert kept == a
    assert told.endswith("that which is reviewed.")
    review(b, "2026-11-24T10:00:00+02:00")
    kept, told = counted(runs)
    assert kept == b
    assert "that which was reviewed last. Both are reviewed: the decisions on one sign" in told


def test_what_was_rejected_stays_out_in_either_order_of_the_folders(tmp_path: Path) -> None:
    drive = passes(1)[0]
    runs = [write_run(tmp_path / name, drive, "same digest") for name in "ab"]
    judged(runs[1], "doubtful")
    review(runs[1])
    for number, order in enumerate((runs, runs[::-1])):
        outcome = merge_runs(order, tmp_path / f"map{number}")
        assert len(outcome.signs) == len(drive) - 1
        assert (
            f"{runs[1]}: its path is doubtful and in the map: it is doubtful."
            in (json.loads((tmp_path / f"map{number}" / "merge.json").read_text())["warnings"])
        )


def test_what_a_reviewer_of_one_drive_rejected_others_saw_in_vain(tmp_path: Path) -> None:
    runs = [write_run(tmp_path / drive.name, drive) for drive in passes(3)]
    before = {sign.id for sign in merge_runs(runs, tmp_path / "before").signs}
    review(runs[0])
    after = merge_runs(runs, tmp_path / "after", previous=tmp_path / "before")
    assert len(before - {sign.id for sign in after.signs}) == 1
    # nobody took it down
    assert after.comparison is not None
    assert (after.comparison.changes, after.comparison.rejected) == ([], 1)
    (told,) = [text for text in after.warnings if "seen by later drives" in text]
    assert told.startswith("1 sign that the review of a drive rejected was seen by later drives")
    assert f"of {after.merged.drives[1].name})" in told
    # the last drive's decision is about what all of them saw before
    (runs[0] / "review.json").rename(runs[2] / "review.json")
    last = merge_runs(runs, tmp_path / "last")
    assert len(last.signs) == len(after.signs)
    assert not any("seen by later drives" in text for text in last.warnings)
    (runs[2] / "review.json").rename(runs[0] / "review.json")
    # who is of another mind keeps it
    review(runs[1], kind="accept")
    assert before == {sign.id for sign in merge_runs(runs, tmp_path / "again").signs}


def test_what_the_review_of_a_map_rejected_and_drives_saw_since_is_told() -> None:
    # 2026-11-24T10:00:00Z is 1,479,549,618 s of GPS time
    seen = [1_479_549_618 - 2, 1_479_549_618 + 2, 1_479_549_618 + 2]
    signs = [
        made_sign(k, last_seen_ns=s * 10**9, status="rejected", reviewed="2026-11-24T10:00:00Z")
        for k, s in enumerate(seen)
    ]
    assert since_reviewed(signs[:1]) == []
    (told,) = since_reviewed(signs)
    assert told.startswith(
        f"2 signs that the review of this map rejected were seen since (as {signs[1].id})"
    )
    # nobody knows when
    assert since_reviewed([replace(signs[1], last_seen_ns=NO_TIME)]) == []


def test_one_of_two_entries_of_a_sign_is_rejected_and_the_sign_stays(tmp_path: Path) -> None:
    drives = passes(3)
    plain = [write_run(tmp_path / "plain" / drive.name, drive) for drive in drives]
    before = [sign.drives for sign in merge_runs(plain, tmp_path / "once").signs]
    # the first drive has its first sign twice, 2 m apart
    twice = [0, *range(len(drives[0]))]
    columns = {
        name: values[twice]
        for name, values in vars(drives[0]).items()
        if isinstance(values, np.ndarray) and len(values) == len(drives[0])
    }
    columns["lat_rad"][0] += 2.0 / 6.37e6
    drives[0] = replace(drives[0], ids=("s0", *drives[0].ids), **columns)
    runs = [write_run(tmp_path / drive.name, drive) for drive in drives]
    review(runs[0])
    after = [sign.drives for sign in merge_runs(runs, tmp_path / "map").signs]
    assert sorted(after) == sorted(before)


def test_the_review_of_a_part_that_is_left_out_is_told_of(tmp_path: Path) -> None:
    count = np.arange(20, dtype=np.int64)
    whole = Marks(count, 0.87 + 1e-5 * count, np.full(20, 0.15), count + 1)
    part = Marks(*(getattr(whole, n)[:12] for n in ("count", "lat_rad", "lon_rad", "frame_ns")))
    review(tmp_path)
    runs = [
        candidate("part", "x", part, {"state": "good"}, tmp_path),
        candidate("whole", "y", whole, {"state": "doubtful"}, None),
    ]
    for order in (runs, runs[::-1]):
        (kept,), (told,) = distinct(order, "another run of")
        assert order[kept].name == "whole"
        assert "part is part of the recording of whole" in told
        assert "It is reviewed: the decisions on one sign of the one left out are not" in told


def test_a_run_with_another_model_is_of_the_same_recording(tmp_path: Path) -> None:
    drive = passes(1)[0]
    runs = [write_run(tmp_path / name, drive, "same digest") for name in ("a", "b")]
    for run, model in zip(runs, ("old", "new"), strict=True):
        record = json.loads((run / "run.json").read_text(encoding="utf-8"))
        record["inputs"]["sign-detector.onnx"] = model
        (run / "run.json").write_text(json.dumps(record), encoding="utf-8")
    assert len(merge_runs(runs, tmp_path / "map").merged.drives) == 1


def test_a_log_cut_short_beside_its_whole_counts_once(tmp_path: Path) -> None:
    import pandas as pd

    drives = passes(2)
    gps_s = 1.46e9 + np.arange(0.0, 300.0, 1.0)
    fixes = pd.DataFrame(
        {"gps_s": gps_s, "lat_rad": 0.87 + 1e-9 * gps_s, "lon_rad": 0.15, "fix_type": 3}
    )
    runs = [
        write_run(tmp_path / name, drive, name) for name, drive in zip("ab", drives, strict=True)
    ]
    for run, share in zip(runs, (1.0, 0.6), strict=True):
        fixes[: int(share * len(fixes))].to_parquet(run / "fixes.parquet")
    outcome = merge_runs(runs, tmp_path / "map")
    assert [drive.name for drive in outcome.merged.drives] == [drives[0].name]
    assert any(f"{runs[1]} is part of the recording" in text for text in outcome.warnings)
