"""``automap merge``: folders in, a map out, names that stay, changes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from geojson_pydantic import FeatureCollection
from merge_folders import CALM, DAY_S, PATH, passes, write_run
from merge_scene import Errors, drive_through, street

from automap.errors import ConfigError, InputError, StageError
from automap.mapping.merge import merge_drives
from pipeline.cli.root import run_command
from pipeline.merge.command import merge_runs
from pipeline.merge.outcome import MergeOutcome
from pipeline.merge.terminal import summary_lines
from pipeline.shared import terminal
from pipeline.shared.lock import locked


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("runs")
    return [write_run(root / f"out{k}", drive) for k, drive in enumerate(passes(4))]


def features(folder: Path) -> dict[str, dict]:  # type: ignore[type-arg]
    content = json.loads((folder / "signs.geojson").read_text(encoding="utf-8"))
    return {f["id"]: f for f in content["features"]}


def test_a_merge_that_takes_long_tells_json_and_nothing_else(
    folders: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(terminal, "_LINE_EVERY_S", -1.0)
    words = ["merge", *map(str, folders[:2]), "-o", str(tmp_path / "map")]
    assert run_command([*words, "--json"]) == 0
    assert "drives" in json.loads(capsys.readouterr().out)
    assert run_command([*words, "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_of_few_drives_nothing_is_said_that_takes_more(
    folders: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in (1, 2):
        out = tmp_path / f"map{number}"
        assert run_command(["merge", *map(str, folders[:number]), "-o", str(out)]) == 0
        page = (out / "report.html").read_text(encoding="utf-8")
        assert ("Of one drive nothing tells how often" in page) == (number == 1)
        # of two drives, that one saw a sign is why the other may have missed it
        assert "seen when in view" not in page
        assert "are seen" not in capsys.readouterr().out
        assert ">regulatory--" not in page


def test_the_map_has_the_files_of_a_run(folders: list[Path], tmp_path: Path) -> None:
    assert run_command(["merge", *map(str, folders), "-o", str(tmp_path / "map")]) == 0
    out = tmp_path / "map"
    for name in ("signs.geojson", "map.kml", "map.gpkg", "signs.parquet", "report.html"):
        assert (out / name).stat().st_size > 0
    FeatureCollection.model_validate_json((out / "signs.geojson").read_text(encoding="utf-8"))
    found = features(out)
    several = [f for f in found.values() if ", " in f["properties"]["drives"]]
    assert len(several) > 0.8 * len(found)
    for feature in found.values():
        assert feature["properties"]["status"] == "ok"
        assert feature["properties"]["first_seen"].endswith("Z")
        # of all drives alike, and what is wrong of a vehicle's height they have in common
        assert feature["properties"]["sd_above_road_m"] == pytest.approx(0.1, abs=1e-3)
    summary = json.loads((out / "merge.json").read_text(encoding="utf-8"))
    assert [d["name"] for d in summary["drives"]] == ["d0", "d1", "d2", "d3"]
    page = (out / "report.html").read_text(encoding="utf-8")
    seen, in_view = (sum(d[k] for d in summary["drives"]) for k in ("seen_of_in_view", "in_view"))
    # what was counted, not the rate as it is held to limits
    assert "seen when in view" in page
    assert f"{seen} of {in_view} times" in page
    assert ("left out of the map" in page) == (summary["unlikely_signs"] > 0)
    assert 'probability">95 % radius' in page
    header = json.loads((out / "signs.geojson").read_text(encoding="utf-8"))["automap"]
    assert header["drives"] == ["d0", "d1", "d2", "d3"]
    assert all(Path(d["folder"]).is_absolute() for d in summary["drives"])
    for drive in summary["drives"]:
        assert abs(drive["offset_m"]["e"]) < 4 * drive["offset_sd_m"]["e"] + 1.0
    assert not (out / "changes.geojson").exists()
    # the other commands take the map as they take a run
    assert run_command(["export", str(out), "--format", "csv"]) == 0
    assert run_command(["export", str(out), "--format", "gpx"]) == 0
    gpx = (out / "trajectory.gpx").read_text(encoding="utf-8")
    assert gpx.count("<wpt ") == len(found)
    assert gpx.count("<trk>") == 4
    assert run_command(["export", str(out), "--format", "gpkg", "--datum", "GDA2020"]) == 0


def test_what_a_run_tells_of_existence_is_merged(tmp_path: Path) -> None:
    drive = passes(1)[0]
    own = np.full(len(drive), 0.97)
    own[0] = 0.9996
    outcome_of([write_run(tmp_path / "run", replace(drive, existence=own))], tmp_path / "map")
    found = sorted(f["properties"]["existence"] for f in features(tmp_path / "map").values())
    assert found[-1] >= 0.999
    assert found[0] == pytest.approx(0.97, abs=0.002)


def test_a_merged_sign_faces_where_the_surer_drives_say() -> None:
    first, second = passes(2)
    away = replace(
        second,
        facing_rad=first.facing_rad[0] + np.full(len(second), 0.4),
        facing_sd_rad=np.full(len(second), 0.5),
    )
    sure = replace(
        first,
        facing_rad=np.full(len(first), first.facing_rad[0]),
        facing_sd_rad=np.full(len(first), 0.05),
    )
    both = [sign for sign in merge_drives([sure, away]).signs if len(sign.drives) == 2]
    assert len(both) > 10
    for sign in both:
        turn = (sign.facing_rad - first.facing_rad[0] + np.pi) % (2.0 * np.pi) - np.pi
        # a hundredth of the weight
        assert turn == pytest.approx(0.4 / 101.0, abs=5e-4)
        assert 0.05 < sign.facing_sd_rad < 0.08


@pytest.mark.parametrize(
    ("countries", "code"),
    [(("DE", "de"), "DE:274-50"), (("DE", None), "DE:274-50"), (("DE", "AU"), None)],
)
def test_codes_of_a_merged_map_are_of_the_country_of_its_drives(
    tmp_path: Path, countries: tuple[str | None, ...], code: str | None
) -> None:
    folders = []
    for number, (drive, country) in enumerate(zip(passes(2), countries, strict=True)):
        names_of = np.full(len(drive), "regulatory--maximum-speed-limit-50--g1", np.object_)
        folder = write_run(tmp_path / f"out{number}", replace(drive, class_name=names_of))
        record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        if country is not None:
            record["stages"] = {"export": {"manifest": {"site.country": country}}}
        (folder / "run.json").write_text(json.dumps(record), encoding="utf-8")
        folders.append(folder)
    outcome_of(folders, tmp_path / "map")
    found = features(tmp_path / "map")
    assert len(found) > 3
    for feature in found.values():
        assert feature["properties"]["code"] == code
        assert feature["properties"]["support"].startswith("p")


def outcome_of(folders: list[Path], out: Path, previous: Path | None = None) -> MergeOutcome:
    return merge_runs(folders, out, previous)


def test_a_merge_that_fails_leaves_the_older_map(
    folders: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, text: str) -> None:
        raise StageError(f"cannot write {path}: the disk is full.")

    out = tmp_path / "map"
    with monkeypatch.context() as patch:
        patch.setattr("pipeline.merge.output.write_text", full)
        with pytest.raises(StageError, match=re.escape(f"cannot write {out / 'report.html'}:")):
            outcome_of(folders[:2], out)
    assert list(out.iterdir()) == []
    outcome_of(folders[:2], out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr("pipeline.merge.output.write_text", full)
        with pytest.raises(StageError):
            outcome_of(folders, out)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_two_merges_into_one_folder(folders: list[Path], tmp_path: Path) -> None:
    (tmp_path / "map").mkdir()
    with locked(tmp_path / "map"), pytest.raises(ConfigError, match="writing there"):
        outcome_of(folders, tmp_path / "map")


def test_a_second_merge_never_meets_the_first(
    folders: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the clearing of leftovers to the last file the folder is one merge's."""
    (tmp_path / "map" / ".merge.left").mkdir(parents=True)
    held = []

    @contextmanager
    def once(folder: Path) -> Iterator[None]:
        held.append((folder / ".merge.left").exists())
        with locked(folder):
            yield

    monkeypatch.setattr("pipeline.merge.output.locked", once)
    outcome_of(folders[:2], tmp_path / "map")
    assert held == [True]
    assert not (tmp_path / "map" / ".merge.left").exists()


def test_the_order_of_the_folders_changes_nothing(folders: list[Path], tmp_path: Path) -> None:
    outcome_of(folders, tmp_path / "a")
    outcome_of(folders[::-1], tmp_path / "b")
    assert features(tmp_path / "a") == features(tmp_path / "b")


@pytest.mark.slow
def test_a_further_drive_renames_no_sign(folders: list[Path], tmp_path: Path) -> None:
    few = {s.id for s in outcome_of(folders[:3], tmp_path / "few").signs}
    more = {s.id for s in outcome_of(folders, tmp_path / "more").signs}
    assert len(few & more) >= len(few) - 1
    # an earlier drive would be the first to see most signs: the older map keeps the names
    outcome_of(folders[1:], tmp_path / "late")
    late = {s.id for s in outcome_of(folders[1:], tmp_path / "late").signs}
    found = outcome_of(folders, tmp_path / "all", tmp_path / "late")
    assert late <= {s.id for s in found.signs} | {
        c.sign.id
        for c in found.comparison.changes  # type: ignore[union-attr]
    }
    assert len(late & {s.id for s in found.signs}) >= len(late) - 1


def test_changes_against_an_older_map(tmp_path: Path) -> None:
    """One sign is taken down, one put up, one gets another face, one moves by eight metres."""
    rng = np.random.default_rng(2)
    town = street(rng, 0.0, 1.0)
    along = np.arange(10) * 40.0
    names = np.full(11, "regulatory--stop--g1", object)
    town = type(town)(
        np.column_stack([np.full(11, -5.0), [*along, 380.0], np.full(11, 2.5)]),
        np.full(11, np.pi),
        names,
    )
    path = np.array([[-1.5, -40.0], [-1.5, 450.0]])
    before = np.ones(11, bool)
    before[10] = False
    after = np.ones(11, bool)
    after[3] = False
    runs = []
    quiet = Errors(clutter=0.0, missed=0.0, wrong_class=0.0)
    for number in range(10):
        late = number >= 5
        here = type(town)(town.position.copy(), town.facing, town.class_name.copy())
        if late:
            here.class_name[5] = "regulatory--yield--g1"
            here.position[7, 1] += 12.0
        drive, _ = drive_through(
            rng, here, path, 12.0, f"d{number}", 1.45e9 + DAY_S * (number + 400 * late), quiet,
            after if late else before,
        )  # fmt: skip
        runs.append(write_run(tmp_path / f"run{number}", drive))
    older = outcome_of(runs[:5], tmp_path / "older")
    assert len(older.signs) == 10
    found = outcome_of(runs[5:], tmp_path / "newer", tmp_path / "older")
    assert found.comparison is not None
    kinds = sorted(change.kind for change in found.comparison.changes)
    assert kinds == ["class", "gone", "moved", "new"]
    by_kind = {change.kind: change for change in found.comparison.changes}
    assert by_kind["class"].sign.class_name == "regulatory--yield--g1"
    assert by_kind["class"].older.class_name == "regulatory--stop--g1"  # type: ignore[union-attr]
    assert by_kind["moved"].distance_m == pytest.approx(12.0, abs=2.0)
    assert by_kind["new"].visited_before is True
    assert {s.id for s in older.signs} - {s.id for s in found.signs} == {by_kind["gone"].sign.id}
    text = (tmp_path / "newer" / "changes.geojson").read_text(encoding="utf-8")
    assert len(FeatureCollection.model_validate_json(text).features) == 4
    # all drives together tell the same, and the map in place is the older one
    again = outcome_of(runs, tmp_path / "newer")
    assert again.comparison is not None
    assert {s.id for s in again.signs} == {s.id for s in found.signs}


def test_signs_that_nobody_passed_are_not_gone(folders: list[Path], tmp_path: Path) -> None:
    outcome_of(folders[:2], tmp_path / "older")
    rng = np.random.default_rng(3)
    far = street(rng, 200.0, 20.0)
    far.position[:, 0] += 3000.0
    drive, _ = drive_through(
        rng, far, PATH + np.array([3000.0, 0.0]), 12.0, "far", 1.46e9, CALM
    )  # fmt: skip
    run = write_run(tmp_path / "far", drive)
    found = outcome_of([run], tmp_path / "map", tmp_path / "older").comparison
    assert found is not None
    assert {c.kind for c in found.changes} == {"new"}
    assert all(c.visited_before is False for c in found.changes)
    assert found.unvisited > 5


def test_folders_that_cannot_be_merged(folders: list[Path], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="given twice"):
        merge_runs([folders[0], folders[0]], tmp_path / "m")
    with pytest.raises(ConfigError, match="one of the runs"):
        merge_runs(folders[:2], folders[0])
    with pytest.raises(ConfigError, match="results of a run"):
        merge_runs(folders[:2], folders[2])
    with pytest.raises(InputError, match="no such output folder"):
        merge_runs([tmp_path / "nowhere"], tmp_path / "m")
    # a name that was mistyped makes no smaller map
    with pytest.raises(InputError, match="nowhere: no such output folder"):
        merge_runs([*folders[:2], tmp_path / "nowhere"], tmp_path / "m")
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="holds no signs"):
        merge_runs([empty], tmp_path / "m")
    # one bad folder does not stop the others
    outcome = merge_runs([folders[0], empty], tmp_path / "m")
    assert any("holds no signs" in text for text in outcome.warnings)
    with pytest.raises(InputError, match="is a merged map"):
        merge_runs([tmp_path / "m"], tmp_path / "n")
    assert run_command(["merge", str(tmp_path / "nowhere"), "-o", str(tmp_path / "x")]) == 3
    assert run_command(["merge", str(folders[0]), "-o", str(folders[0])]) == 2


def test_drives_of_one_name_are_told_apart(tmp_path: Path) -> None:
    first, second = passes(2)
    runs = [
        write_run(tmp_path / "a", first, "x"),
        write_run(tmp_path / "b", type(second)(**{**vars(second), "name": "d0"}), "y"),
    ]
    outcome = merge_runs(runs, tmp_path / "map")
    assert [d.name for d in outcome.merged.drives] == ["d0", "d0-2"]


def test_hostile_names_are_only_text(tmp_path: Path) -> None:
    drive = passes(1)[0]
    name = '<script>alert(1)</script>"&=1+1'
    drive = type(drive)(**{**vars(drive), "name": name})
    drive.class_name[0] = "<img src=x onerror=alert(1)>"
    merge_runs([write_run(tmp_path / "a", drive)], tmp_path / "map")
    page = (tmp_path / "map" / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert "<img" not in page


def test_only_the_geojson_of_a_run_is_enough(tmp_path: Path) -> None:
    """A map of other software, or of an older version: no tables, no trajectory."""
    drive = passes(1)[0]
    full = write_run(tmp_path / "a", drive)
    merge_runs([full], tmp_path / "map")
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "signs.geojson").write_bytes((tmp_path / "map" / "signs.geojson").read_bytes())
    outcome = merge_runs([bare], tmp_path / "again")
    assert len(outcome.signs) == len(features(tmp_path / "map"))
    assert any("without a trajectory" in text for text in outcome.warnings)
    # nor is it told how far it lies off, with a sigma of nothing
    assert not any("offset" in line for line in summary_lines(outcome))
    (drive,) = json.loads((tmp_path / "again" / "merge.json").read_text())["drives"]
    assert set(drive["offset_m"].values()) == {None}
    assert "± 0.00" not in (tmp_path / "again" / "report.html").read_text(encoding="utf-8")
