"""Damaged files through every reader: what the long run does, for some seconds."""

from __future__ import annotations

import os
import random
import time
import warnings
from pathlib import Path

import pytest

from tests.fuzz import attempt as attempts
from tests.fuzz import run
from tests.fuzz.attempt import attempt
from tests.fuzz.batches import in_process
from tests.fuzz.mutations import damaged, mended
from tests.fuzz.run import Harness, found_files, fuzz, seeds


@pytest.mark.parametrize("name", list(seeds()))
def test_a_whole_file_is_read(name: str) -> None:
    assert attempt(name, seeds()[name]).kind == "read"


@pytest.mark.parametrize(
    ("name", "path"), found_files(), ids=lambda value: getattr(value, "stem", "")
)
def test_what_once_went_wrong_is_read_or_refused(name: str, path: Path) -> None:
    outcome = attempt(name, path.read_bytes())
    assert outcome.good, outcome


@pytest.mark.parametrize("name", list(seeds()))
def test_damaged_files_give_a_result_or_one_sentence(name: str) -> None:
    # ten seconds for all, and the long run does the rest
    harness = Harness(name, [seeds()[name]])
    fuzz(harness, 100, 0.08, seed=len(name))
    assert not harness.wrong
    assert harness.count >= 1


def test_the_same_seed_damages_alike_and_checksums_are_right() -> None:
    data = seeds()["rx_mixed"]
    assert damaged(data, random.Random(3)) == damaged(data, random.Random(3)) != data
    spoilt = bytearray(data)
    spoilt[6] ^= 1
    assert mended(data) == data
    assert mended(bytes(spoilt)) != bytes(spoilt)


@pytest.mark.parametrize("error", [ZeroDivisionError("x"), RuntimeWarning("overflow")])
def test_what_is_not_ours_is_found(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def read(path: Path, work: Path) -> object:
        if isinstance(error, Warning):
            warnings.warn(error, stacklevel=2)
            return None
        raise error

    monkeypatch.setattr(attempts, "_reader", lambda name: read)
    harness = Harness("imu_csv", [seeds()["imu_csv"]])
    fuzz(harness, 2, 10.0, seed=1)
    assert len(harness.wrong) == 1


def test_a_process_that_dies_or_hangs_is_told_of(tmp_path: Path) -> None:
    assert in_process(lambda: 1 + 1, tmp_path, 60.0) == 2
    assert in_process(lambda: os._exit(7), tmp_path, 60.0) == "exit code 7"
    assert in_process(lambda: time.sleep(99), tmp_path, 0.1) == "exit code -9"


def test_the_nth_file_of_a_harness_is_the_same_in_every_run() -> None:
    whole, parts = (Harness("review_json", [seeds()["review_json"]]) for _ in range(2))
    fuzz(whole, 12, 10.0, seed=5)
    for _ in range(3):
        fuzz(parts, 4, 10.0, seed=5)
    assert whole.pool == parts.pool
    assert whole.table == parts.table


def test_a_run_goes_on_after_the_file_that_ended_its_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fourth = iter([False, False, False, True] + [False] * 9)

    def read(name: str, data: bytes) -> run.Outcome:
        return run.Outcome("read", "") if not next(fourth) else os._exit(7)

    monkeypatch.setattr(run, "attempt", read)
    harness = run._batch(Harness("run_json", [b"{}"]), 9, 1, tmp_path)
    assert (harness.number, harness.table) == (4, {"died": 1})
    fourth = iter([False] * 9)
    harness = run._batch(harness, 5, 1, tmp_path)
    assert (harness.number, harness.table) == (9, {"died": 1, "read": 5})
