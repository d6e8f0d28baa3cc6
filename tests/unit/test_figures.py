"""Results do not move unnoticed: figures of short computations are those that were kept.

Where results are meant to move, ``python -m tests.unit.figures`` writes them anew, and
``CHANGELOG.md`` says by how much.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.slow_cases import others_slow
from tests.unit import figures
from tests.unit.figures import FOLDER, KEPT_FOR, STAGES, differences, figures_of, kept
from tests.unit.scenarios import SCENARIOS

SAME = 5e-5
"""Of a figure's size. Other processors and compilers change the eleventh digit; what iterates to a
tolerance ended 3e-6 of its size away on one."""
SAME_RUN = 3e-3
"""Of those of whole runs, which search noise levels until a step gains little: on a processor
without the widest instructions one ended 1.1e-3 of its size away."""


# each of these takes some seconds
DEAR = (
    "calibration_fits",
    "compare_inventories",
    "fusion_offsets",
    "fusion_problem",
    "geolocation_late",
    "geolocation_rays",
    "runs_carriers",
    "runs_contradicted",
    "runs_unknown_axes",
    "sync_clock",
    "sync_correlation_clock",
    "sync_held",
    "sync_receiver",
)
NAMES = sorted(SCENARIOS, key=lambda name: (name in DEAR, name))


@pytest.mark.parametrize("name", others_slow(NAMES, len(NAMES) - len(DEAR)))
def test_figures_are_those_that_were_kept(name: str) -> None:
    same = SAME_RUN if name.startswith("runs_") else SAME
    told = differences(figures_of(SCENARIOS[name]()), kept(name), same)
    assert not told, f"{name}: {len(told)} figures moved, {sorted(told)[:5]}"


def test_every_file_of_figures_has_its_scenario() -> None:
    assert {path.stem for path in FOLDER.glob("*.json")} == SCENARIOS.keys()


def test_figures_of_a_stage_move_with_its_version() -> None:
    versions = json.loads(KEPT_FOR.read_text())
    told = [figures.not_raised(name, versions) for name in sorted(SCENARIOS)]
    assert not any(told), "\n".join(text for text in told if text)
    of_stages = {name for name in SCENARIOS if figures.stage_version(name) is not None}
    assert versions.keys() == of_stages, "run python -m tests.unit.figures"
    assert {name.partition("_")[0] for name in of_stages} == STAGES.keys()
    for name, (checksum, version) in versions.items():
        assert checksum == figures.checksum(name), f"python -m tests.unit.figures {name}"
        assert version <= (figures.stage_version(name) or 0)


def test_figures_that_move_ask_for_a_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "FOLDER", tmp_path)
    (tmp_path / "sync_words.json").write_text("{}")
    version = figures.stage_version("sync_words")
    assert version is not None
    before = {"sync_words": [figures.checksum("sync_words"), version]}
    assert figures.not_raised("sync_words", before) is None
    (tmp_path / "sync_words.json").write_text('{"a": "b"}')
    assert f"version {version} of the stage sync" in str(figures.not_raised("sync_words", before))
    before["sync_words"][1] -= 1
    assert figures.not_raised("sync_words", before) is None


@pytest.mark.parametrize("rows", [2, 7, 40])
def test_figures_tell_signs_order_and_digits(rows: int) -> None:
    values = [0.3 * k**2 - 1.0 for k in range(rows)]
    whole = figures_of({"a": values})
    assert not differences(figures_of({"a": values}), whole, SAME)
    swapped = [values[1], values[0], *values[2:]]
    turned = [-values[0], *values[1:]]
    moved = [*values[:-1], values[-1] * (1.0 + 1e-3)]
    for other in (swapped, turned, moved, values[:-1], [float("nan"), *values[1:]]):
        assert differences(figures_of({"a": other}), whole, SAME)
    assert differences(figures_of({"b": values}), whole, SAME)
