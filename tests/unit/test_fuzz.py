"""Damaged files through every reader: what the long run does, for some seconds."""

from __future__ import annotations

import random
import warnings
from pathlib import Path

import pytest

from tests.fuzz.attempt import attempt
from tests.fuzz.mutations import damaged, mended
from tests.fuzz.run import found_files, fuzz, seeds
from tests.unit import broken_readers


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
    # half a minute for all, and the long run does the rest
    table, wrong = fuzz([name], 100, 0.35, seed=len(name))
    assert not wrong
    assert sum(table.values()) >= 1


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

    monkeypatch.setitem(broken_readers.READERS, "imu_csv", read)
    _, wrong = fuzz(["imu_csv"], 2, 10.0, seed=1)
    assert len(wrong) == 1
