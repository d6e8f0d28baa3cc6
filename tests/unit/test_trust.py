"""What a drive names lies inside it, unless the user says otherwise: nothing else is read."""

from __future__ import annotations

import os
import shutil
import stat
import zipfile
from pathlib import Path

import pytest
from input_drive import write_drive

from automap.errors import ConfigError, InputError
from automap.io import trust
from automap.io.drive import load_drive
from automap.io.vector_layer import read_layer
from pipeline.cli.root import run_command

SECRET = "root:x:0:0:a very secret line"
KEYS = {
    "imu": 'file = "{}"',
    "gnss": 'file = "{}"',
    "odometer": 'file = "{}"',
    "video.front": 'frames = "{}"',
}


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A file of the reader's that is none of the drive's business."""
    path = tmp_path / "home" / "secret.csv"
    path.parent.mkdir()
    path.write_text(f"{SECRET}\n" * 20)
    return path


def everything_written(folder: Path) -> bytes:
    return b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())


def named(drive: Path, section: str, line: str) -> None:
    manifest = drive / "drive.toml"
    manifest.write_text(f'schema = "automap.drive/1"\n[{section}]\n{line}\n')


@pytest.mark.parametrize("section", KEYS)
@pytest.mark.parametrize("way", ["absolute", "upwards", "link", "link of a folder"])
def test_a_manifest_names_no_file_outside(
    tmp_path: Path, secret: Path, section: str, way: str, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_drive(tmp_path / "drive")
    (drive / "linked").symlink_to(secret.parent)
    (drive / "link.csv").symlink_to(secret)
    text = {
        "absolute": str(secret),
        "upwards": "../home/secret.csv",
        "link": "link.csv",
        "link of a folder": "linked/secret.csv",
    }[way]
    named(drive, section, KEYS[section].format(text))
    for command in (["run", str(drive), "-o", str(tmp_path / "out")], ["check", str(drive)]):
        assert run_command(command) in (2, 3)
        told = "".join(capsys.readouterr())
        assert "--allow-outside" in told
        assert "secret line" not in told
    if (tmp_path / "out").exists():
        assert b"secret line" not in everything_written(tmp_path / "out")


@pytest.mark.parametrize("name", ["imu.csv", "gnss.nmea", "gnss_arrival.csv", "drive.toml"])
def test_a_file_of_a_usual_name_is_no_link_out(tmp_path: Path, secret: Path, name: str) -> None:
    drive = write_drive(tmp_path / "drive")
    (drive / name).unlink()
    (drive / name).symlink_to(secret)
    with pytest.raises(ConfigError, match="leads out of the folder by a link") as caught:
        load_drive(drive)
    assert "secret line" not in str(caught.value)


@pytest.mark.parametrize("folder", ["video", "truth"])
def test_nor_are_videos_and_the_truth(tmp_path: Path, secret: Path, folder: str) -> None:
    drive = write_drive(tmp_path / "drive")
    (drive / folder).mkdir()
    (drive / folder / "front.mp4").symlink_to(secret)
    with pytest.raises(ConfigError, match="--allow-outside"):
        load_drive(drive)


def test_a_preset_is_the_drives_own_or_one_that_comes_along(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive")
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "mine.toml").write_text('schema = "automap.sensor/1"\n')
    for text in (str(tmp_path / "home/mine"), "../home/mine"):
        named(drive, "imu", f'sensor = "{text}"')
        with pytest.raises(ConfigError, match="--allow-outside"):
            load_drive(drive)


def test_links_inside_a_drive_are_its_own_business(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive")
    (drive / "imu.csv").rename(drive / "readings.csv")
    (drive / "imu.csv").symlink_to("readings.csv")
    linked = tmp_path / "by another name"
    linked.symlink_to(drive)
    assert load_drive(linked).imu_file == linked / "imu.csv"


@pytest.mark.slow
def test_the_user_may_allow_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = write_drive(tmp_path / "drive")
    elsewhere = tmp_path / "disk"
    elsewhere.mkdir()
    shutil.move(drive / "imu.csv", elsewhere / "imu.csv")
    manifest = drive / "drive.toml"
    text = manifest.read_text().replace("[imu]", f'[imu]\nfile = "{elsewhere / "imu.csv"}"')
    manifest.write_text(text)
    words = ["run", str(drive), "-o", str(tmp_path / "out"), "--to", "ingest", "--quiet"]
    assert run_command(words) == 2
    assert run_command([*words, "--allow-outside", str(tmp_path / "other")]) == 2
    assert run_command([*words, "--allow-outside", str(elsewhere)]) == 0
    # for that command alone
    assert trust.VARIABLE not in os.environ
    assert run_command([*words, "--force"]) == 2
    monkeypatch.setenv(trust.VARIABLE, f"{tmp_path / 'other'}{os.pathsep}{elsewhere}")
    assert run_command([*words, "--force"]) == 0
    capsys.readouterr()


def test_a_folder_beside_an_allowed_one_is_not_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(trust.VARIABLE, str(tmp_path / "disk"))
    assert not trust.leads_out(tmp_path / "disk" / "a.csv", tmp_path / "drive")
    assert trust.leads_out(tmp_path / "disk2" / "a.csv", tmp_path / "drive")
    assert trust.leads_out(tmp_path / "disk" / ".." / "a.csv", tmp_path / "drive")


@pytest.mark.parametrize("words", [["init"], ["import", "gnss-logger"]])
def test_links_in_what_is_imported_lead_nowhere_else(
    tmp_path: Path, secret: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_drive(tmp_path / "recordings")
    (drive / "drive.toml").unlink()
    (drive / "log.csv").symlink_to(secret)
    assert run_command([*words, str(drive), "-o", str(tmp_path / "made")]) == 2
    told = "".join(capsys.readouterr())
    assert "--allow-outside" in told
    assert "secret line" not in told
    assert not (tmp_path / "made").exists()


def test_an_archive_makes_no_links_and_writes_nothing_outside(
    tmp_path: Path, secret: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_drive(tmp_path / "recordings")
    archive = tmp_path / "log.zip"
    with zipfile.ZipFile(archive, "w") as file:
        file.write(drive / "imu.csv", "imu.csv")
        file.write(drive / "imu.csv", "../../outside.csv")
        file.write(drive / "imu.csv", str(tmp_path / "absolute.csv"))
        link = zipfile.ZipInfo("link.csv")
        link.create_system, link.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
        file.writestr(link, str(secret))
    before = {path for path in tmp_path.rglob("*") if "made" not in path.parts}
    run_command(["init", str(archive), "-o", str(tmp_path / "made"), "--yes"])
    told = "".join(capsys.readouterr())
    assert "secret line" not in told
    assert {path for path in tmp_path.rglob("*") if "made" not in path.parts} == before
    assert not [path for path in (tmp_path / "made").rglob("*") if path.is_symlink()]
    assert b"secret line" not in everything_written(tmp_path / "made")


def test_a_drive_that_init_makes_elsewhere_is_whole(tmp_path: Path) -> None:
    """Its videos are second names of the files, which lead nowhere."""
    source = write_drive(tmp_path / "recordings")
    (source / "drive.toml").unlink()
    (source / "front.mp4").write_bytes(b"no video")
    run_command(["init", str(source), "-o", str(tmp_path / "made"), "--yes"])
    (video,) = load_drive(tmp_path / "made").videos.values()
    (chapter,) = video.chapters
    assert not chapter.is_symlink()
    assert chapter.samefile(source / "front.mp4")


def test_roads_of_a_drive_are_inside_and_are_data(tmp_path: Path, secret: Path) -> None:
    from pipeline.run.stages.export import STAGE

    drive = write_drive(tmp_path / "drive")
    manifest = drive / "drive.toml"
    manifest.write_text(manifest.read_text() + f'[site]\nroads = "{secret}"\n')
    with pytest.raises(ConfigError, match="roads"):
        STAGE.inputs(load_drive(drive))
    redirection = drive / "roads.vrt"
    redirection.write_text(
        "<OGRVRTDataSource><OGRVRTLayer name='secret'>"
        f"<SrcDataSource>{secret}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>"
    )
    with pytest.raises(InputError, match="only says where else"):
        read_layer(redirection)


def test_a_log_is_not_written_through_a_link(tmp_path: Path, secret: Path) -> None:
    drive = write_drive(tmp_path / "drive")
    (drive / "_automap").mkdir()
    (drive / "_automap" / "automap.log").symlink_to(secret)
    before = secret.read_bytes()
    assert run_command(["run", str(drive), "--to", "ingest", "--quiet"]) == 2
    assert secret.read_bytes() == before


def test_the_truth_that_evaluate_reads_is_the_drives(tmp_path: Path, secret: Path) -> None:
    from pipeline.evaluate.command import evaluate_run

    drive = write_drive(tmp_path / "drive")
    (drive / "truth").mkdir()
    (drive / "truth" / "trajectory.csv").symlink_to(secret)
    (drive / "_automap").mkdir()
    with pytest.raises(ConfigError, match="--allow-outside"):
        evaluate_run(drive / "_automap")
