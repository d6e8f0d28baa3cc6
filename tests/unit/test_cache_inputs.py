"""The cache against every input of every stage: what a stage uses is declared, and what is declared
makes it run again, one by one."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from input_drive import write_drive

from automap.effects.user import set_user_effects
from automap.io import names
from automap.io.drive import Drive, load_drive
from pipeline.run import registry
from pipeline.run.cache import gather, why_run
from pipeline.run.digests import DigestCache
from pipeline.run.runner import Request, run_drive
from pipeline.run.stage import Stage, StageContext
from pipeline.settings.load import Settings, load_settings
from pipeline.shared.run_record import read_record

EFFECT = """
from automap.effects import UserTerm, user_effect

def hum(signals):
    return signals.speed

EFFECTS = [user_effect("hum", "wheels hum", UserTerm("k", "gyro_z", hum, 1e-4))]
"""
SIGNS = """frame,class,x_min,y_min,x_max,y_max,score
10,give_way,600,300,630,330,0.9
11,give_way,610,299,641,331,0.9
12,give_way,622,298,654,331,0.9
"""
ROAD = (
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"name": "A1"}, '
    '"geometry": {"type": "LineString", "coordinates": [[148.99, -35.0], [149.02, -35.0]]}}]}'
)
CONTROL = (
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": '
    '{"class": "give_way", "sd_m": 0.1}, "geometry": {"type": "Point", "coordinates": '
    "[149.001, -35.0]}}]}"
)
SENSOR = """schema = "automap.sensor/1"
[gyro]
counts_per_unit = 1000.0
noise_density = 0.01
[accel]
counts_per_unit = 1000.0
noise_density = 0.001
"""
RECEIVER = """schema = "automap.receiver/1"
[errors]
white_share = 0.5
"""


def make_drive(folder: Path) -> Path:
    """A drive with a file of every kind that a stage may read, but for those that would take the
    place of others (a finished trajectory, bearings, the video itself)."""
    write_drive(folder, 'sensor = "mine"', 'receiver = "my-receiver"')
    (folder / "mine.toml").write_text(SENSOR)
    (folder / "my-receiver.toml").write_text(RECEIVER)
    stamps = "".join(f"{frame},{700_000_000_000 + frame * 100_000_000}\n" for frame in range(600))
    (folder / "video").mkdir()
    (folder / "video" / "front_frames.csv").write_text("frame,t_ns\n" + stamps)
    (folder / "video" / "front_detections.csv").write_text(SIGNS)
    speeds = "".join(f"{700_000_000_000 + i * 100_000_000},{12 + i % 3}\n" for i in range(800))
    (folder / "odometer.csv").write_text("t_ns,speed_m_s\n" + speeds)
    (folder / "roads.geojson").write_text(ROAD)
    (folder / names.CONTROL_SIGNS).write_text(CONTROL)
    manifest = folder / "drive.toml"
    manifest.write_text(
        manifest.read_text()
        + '[site]\ncountry = "AU"\nroads = "roads.geojson"\n[vehicle]\nimu_above_road_m = 1.1\n'
        "[video.front]\nwidth = 1280\nheight = 720\n"
        "camera_matrix = [[1000.0, 0.0, 640.0], [0.0, 1000.0, 360.0], [0.0, 0.0, 1.0]]\n"
    )
    return folder


def make_settings(folder: Path) -> Settings:
    """Settings that name files: a user's effects."""
    (folder / "hum.py").write_text(EFFECT)
    (folder / "config.toml").write_text('[effects]\nfiles = ["hum.py"]\n')
    return load_settings(folder / "config.toml")


@dataclass
class Used:
    """What a stage touched while it ran."""

    files: set[Path] = field(default_factory=set)
    settings: set[str] = field(default_factory=set)
    manifest: set[str] = field(default_factory=set)


class Noted:
    """Stands for an object and notes which of its attributes are asked for."""

    def __init__(self, whole: Any, asked: set[str]) -> None:
        self._whole, self._asked = whole, asked

    def __getattr__(self, name: str) -> Any:
        self._asked.add(name)
        return getattr(self._whole, name)


_watching: list[Used] = []


def _on_event(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and _watching and isinstance(arguments[0], str):
        mode = arguments[1]
        if mode is None or not set(str(mode)) & set("wax+"):
            _watching[-1].files.add(Path(arguments[0]))


def watched(stage: Stage, used: Used) -> Stage:
    """The stage, with what it touches noted."""

    def run(context: StageContext) -> None:
        noted: Any = Noted(context.settings, used.settings)
        manifest: Any = Noted(context.drive.manifest, used.manifest)
        context.settings, context.drive = noted, replace(context.drive, manifest=manifest)
        _watching.append(used)
        try:
            stage.run(context)
        finally:
            _watching.clear()

    return replace(stage, run=run)


@dataclass(frozen=True)
class Ran:
    """A drive that went through all stages, and what each used."""

    drive: Path
    out: Path
    settings: Settings
    stages: list[Stage]
    used: dict[str, Used]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ran]:
    folder = tmp_path_factory.mktemp("cache")
    drive, settings = make_drive(folder / "drive"), make_settings(folder)
    sys.addaudithook(_on_event)
    stages = registry.load_stages(registry.ORDER)
    used = {stage.name: Used() for stage in stages}
    request = Request(
        stages=[watched(stage, used[stage.name]) for stage in stages],
        selected=registry.ORDER,
        settings=settings,
        force=False,
        dry_run=False,
        command=[],
    )
    outcome = run_drive(drive, folder / "out", request)
    assert outcome.exit_code == 0, outcome.error
    yield Ran(drive, folder / "out", settings, stages, used)
    set_user_effects([])


def test_a_stage_reads_no_file_that_it_does_not_declare(ran: Ran) -> None:
    drive = load_drive(ran.drive)
    for stage in ran.stages:
        declared = {*stage.inputs(drive), *stage.setting_files(ran.settings)}
        declared |= {ran.out / need for need in stage.needs}
        # what the manifest says is in the key by its values
        declared |= {drive.manifest_file}
        ours = (ran.drive, ran.out, ran.drive.parent / "hum.py")
        work = ran.out / f"{stage.name}.tmp"
        read = {
            path
            for path in ran.used[stage.name].files
            if any(path.is_relative_to(each) for each in ours) and not path.is_relative_to(work)
        }
        extra = {p for p in read - declared if p.suffix != ".log" and p.is_file()}
        assert not extra, stage.name


def test_something_was_watched(ran: Ran) -> None:
    assert ran.drive / "imu.csv" in ran.used["ingest"].files
    assert ran.drive / names.CONTROL_SIGNS in ran.used["geolocate"].files
    assert "geolocate" in ran.used["geolocate"].settings
    assert "vehicle" in ran.used["geolocate"].manifest


def test_a_stage_uses_no_settings_that_it_does_not_declare(ran: Ran) -> None:
    for stage in ran.stages:
        sections = ran.used[stage.name].settings & set(Settings.model_fields)
        assert sections <= set(stage.settings), stage.name


def test_a_stage_uses_no_part_of_the_manifest_that_it_does_not_declare(ran: Ran) -> None:
    for stage in ran.stages:
        if stage.manifest is not None:
            declared = {*stage.manifest, "model_fields_set"}
            assert ran.used[stage.name].manifest <= declared, stage.name
        if stage.blind:
            assert "video" not in ran.used[stage.name].manifest, stage.name


def reasons(
    ran: Ran, stage: Stage, settings: Settings | None = None, drive: Drive | None = None
) -> str | None:
    """Why the stage would run now; its digests are remembered by nobody."""
    record = read_record(ran.out)["stages"]
    earlier = [record[each.name] for each in ran.stages[: ran.stages.index(stage)]]
    digests = DigestCache(ran.drive / "no such folder")
    now = gather(
        stage, drive or load_drive(ran.drive), ran.out, settings or ran.settings, digests, earlier
    )
    return why_run(now, record[stage.name], ran.out, digests, {}, [])


def test_nothing_runs_again_where_nothing_changed(ran: Ran) -> None:
    assert {stage.name: reasons(ran, stage) for stage in ran.stages} == dict.fromkeys(
        registry.ORDER
    )


def changed(path: Path, look: Callable[[], str | None]) -> str | None:
    """What ``look`` says while one byte of a file is another."""
    whole = path.read_bytes()
    try:
        path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
        return look()
    finally:
        path.write_bytes(whole)


@pytest.mark.parametrize("name", registry.ORDER)
def test_one_byte_of_any_file_makes_a_stage_run(ran: Ran, name: str) -> None:
    stage = next(each for each in ran.stages if each.name == name)
    drive = load_drive(ran.drive)
    files = [p for p in (*stage.inputs(drive), *stage.setting_files(ran.settings)) if p.is_file()]
    files += [ran.out / n for n in stage.needs if (ran.out / n).is_file() and n != names.RUN]
    files += [ran.out / n for n in stage.outputs if (ran.out / n).is_file()]
    for path in dict.fromkeys(files):
        if path == drive.manifest_file:
            continue
        told = changed(path, lambda: reasons(ran, stage, drive=drive))
        assert told is not None, f"{name}: {path.name}"
        assert path.name in told, told
        assert reasons(ran, stage) is None


def test_every_file_of_the_drive_is_some_stages(ran: Ran) -> None:
    drive = load_drive(ran.drive)
    declared = {path for stage in ran.stages for path in stage.inputs(drive)}
    there = {path for path in ran.drive.rglob("*") if path.is_file()}
    assert there <= declared | {drive.manifest_file}


def _leaves(value: Any, *path: str) -> Iterator[tuple[str, ...]]:
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, *path, key)
    else:
        yield path


@pytest.mark.parametrize("name", registry.ORDER)
def test_every_setting_of_its_sections_makes_a_stage_run(ran: Ran, name: str) -> None:
    stage = next(each for each in ran.stages if each.name == name)
    for path in _leaves(ran.settings.echo(stage.settings)):

        class Other(Settings):
            """The settings with one value changed."""

            def echo(self, sections: Any = None, path: tuple[str, ...] = path) -> dict[str, Any]:
                whole = super().echo(sections)
                inner = whole
                for key in path[:-1]:
                    inner = inner[key]
                inner[path[-1]] = "something else"
                return whole

        other = Other.model_construct(**dict(ran.settings))
        told = reasons(ran, stage, settings=other)
        assert told is not None, path
        assert ".".join(path) in told


@pytest.mark.parametrize("name", registry.ORDER)
def test_every_declared_section_of_the_manifest_makes_a_stage_run(ran: Ran, name: str) -> None:
    stage = next(each for each in ran.stages if each.name == name)
    manifest = ran.drive / names.MANIFEST
    whole = manifest.read_text()
    lines = {
        "imu": ("[imu]", "[imu]\ntime = 'boot_ns'"),
        "gnss": ("[0.2, 0.0, -1.0]", "[0.3, 0.0, -1.0]"),
        "video": ("[video.front]", "[video.front]\ntime = 'boot_ns'"),
        "camera": ("width = 1280", "width = 1281"),
        "vehicle": ("imu_above_road_m = 1.1", "imu_above_road_m = 1.2"),
        "site": ('country = "AU"', 'country = "NZ"'),
        "name": ('name = "formula"', 'name = "other"'),
    }
    for section, (old, new) in lines.items():
        assert old in whole
        try:
            manifest.write_text(whole.replace(old, new))
            told = reasons(ran, stage)
        finally:
            manifest.write_text(whole)
        of = "video" if section == "camera" else section
        declared = stage.manifest is None or of in stage.manifest
        declared &= not (section == "camera" and stage.blind)
        assert (told is not None) == declared, section
        # but for comments and layout
        try:
            manifest.write_text("# a comment\n\n" + whole)
            assert reasons(ran, stage) is None
        finally:
            manifest.write_text(whole)


@pytest.mark.parametrize("name", registry.ORDER)
def test_a_version_makes_a_stage_run(ran: Ran, name: str) -> None:
    stage = next(each for each in ran.stages if each.name == name)
    told = reasons(replace_stage(ran, stage), replace(stage, version=stage.version + 1))
    assert told == f"version {stage.version} -> {stage.version + 1}"


def replace_stage(ran: Ran, stage: Stage) -> Ran:
    """The same run with the stage raised by a version among its stages."""
    newer = replace(stage, version=stage.version + 1)
    return replace(ran, stages=[newer if each is stage else each for each in ran.stages])


@pytest.mark.parametrize("name", registry.ORDER)
def test_an_output_that_is_gone_makes_a_stage_run(ran: Ran, name: str, tmp_path: Path) -> None:
    stage = next(each for each in ran.stages if each.name == name)
    written = [n for n in stage.outputs if (ran.out / n).is_file()]
    assert written
    for output in written:
        shutil.move(ran.out / output, tmp_path / "kept")
        try:
            assert f"output {output} is missing" in str(reasons(ran, stage))
        finally:
            shutil.move(tmp_path / "kept", ran.out / output)


def test_the_files_of_a_users_detector_make_detect_run(ran: Ran, tmp_path: Path) -> None:
    """Its description, its model and what a model of large weights has beside it."""
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "mine.toml").write_text(
        'schema = "automap.detector/1"\nmodel = "mine.onnx"\nclasses = ["stop"]\n'
    )
    (mine / "mine.onnx").write_bytes(b"a model")
    (mine / "mine.onnx.data").write_bytes(b"its weights")
    stage = next(each for each in ran.stages if each.name == "detect")

    def key(folder: Path = mine) -> str:
        text = json.dumps(str(folder / "mine.toml"))
        settings = load_settings(None, [f"detect.detector={text}"])
        digests = DigestCache(tmp_path / "no such folder")
        return gather(stage, load_drive(ran.drive), ran.out, settings, digests, []).key("detect")

    before = key()
    for name in ("mine.toml", "mine.onnx", "mine.onnx.data"):
        assert changed(mine / name, key) != before, name
        assert key() == before
    # where they lie does not count
    shutil.copytree(mine, tmp_path / "elsewhere")
    assert key(tmp_path / "elsewhere") == before


def test_all_parts_of_a_shapefile_make_export_run(ran: Ran, tmp_path: Path) -> None:
    for suffix in ("shp", "shx", "dbf", "prj"):
        (tmp_path / f"roads.{suffix}").write_bytes(b"part")
    stage = next(each for each in ran.stages if each.name == "export")
    settings = load_settings(None, [f"export.roads={json.dumps(str(tmp_path / 'roads.shp'))}"])
    assert {p.suffix for p in stage.setting_files(settings)} == {".shp", ".shx", ".dbf", ".prj"}
