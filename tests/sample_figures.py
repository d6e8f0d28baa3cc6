"""Runs the sample drive and compares its figures with the stored ones."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from pipeline.cli.root import run_command

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "data" / "sample-drive"
EXPECTED = ROOT / "data" / "sample-drive.expected.json"


def run_sample(folder: Path, *options: str) -> dict[str, Any]:
    """Run a copy of the drive and return its metrics and, beside them, its evaluation."""
    drive = folder / SAMPLE.name
    shutil.copytree(SAMPLE, drive, ignore=shutil.ignore_patterns("_automap"))
    out = folder / "out"
    assert run_command(["run", str(drive), "-o", str(out), *options]) == 0
    assert run_command(["evaluate", str(out)]) == 0
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    evaluation = json.loads((out / "evaluation.json").read_text(encoding="utf-8"))
    return {**record["metrics"], **evaluation}


def stored(part: str) -> list[dict[str, Any]]:
    """The stored figures of a part, each with its tolerance and where that comes from."""
    rows: list[dict[str, Any]] = json.loads(EXPECTED.read_text(encoding="utf-8"))[part]
    return rows


def compare(figures: dict[str, Any], part: str) -> list[str]:
    """A sentence for every stored figure of a part that is missed."""
    missed = []
    for row in stored(part):
        value: Any = figures
        for key in row["figure"].split("."):
            value = value[key]
        if value != pytest.approx(row["value"], rel=0, abs=row["tolerance"] + 1e-9):
            missed.append(
                f"{row['figure']} is {value:.6g} {row['unit']}, not {row['value']} within "
                f"{row['tolerance']} ({row['tolerance_is']})"
            )
    return missed
