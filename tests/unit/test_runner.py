"""The runner: what runs and why, what is left after a failure, the record."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from automap.errors import ConfigError, InputError, StageError
from pipeline.run import execute
from pipeline.run.batch import out_folders, requested, run_drives
from pipeline.run.runner import Request, run_drive
from pipeline.run.stage import Stage, StageContext
from pipeline.settings.load import load_settings
from pipeline.shared.lock import locked
from pipeline.shared.progress import Outcome, Reporter
from pipeline.shared.summary import summary_lines
from tests.unit.fake_stages import doubler, make_drive, reader, teller

Stages = Sequence[Stage]


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return make_drive(tmp_path / "drive")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


def request(
    stages: Stages | None = None,
    selected: Sequence[str] | None = None,
    assignments: Sequence[str] = (),
    force: bool = False,
    dry_run: bool = False,
) -> Request:
    stages = stages or (reader(), doubler(), teller())
    return Request(
        stages=stages,
        selected=selected or [stage.name for stage in stages],
        settings=load_settings(None, assignments),
        force=force,
        dry_run=dry_run,
        command=["automap", "run", "drive"],
    )


def states(outcome: Outcome) -> dict[str, str]:
    return {line.name: line.state for line in outcome.stages}


def reasons(outcome: Outcome) -> dict[str, str]:
    return {line.name: line.reason for line in outcome.stages if line.reason}


def record(out: Path) -> dict[str, object]:
    value: dict[str, object] = json.loads((out / "run.json").read_text())
    return value


def visible(out: Path) -> set[str]:
    return {path.name for path in out.iterdir() if not path.name.startswith(".")}


ALL_KEPT = {"ingest": "kept", "detect": "kept", "report": "kept"}
ALL_RAN = {"ingest": "ran", "detect": "ran", "report": "ran"}


def test_first_run_writes_everything_and_the_second_keeps_it(drive: Path, out: Path) -> None:
    first = run_drive(drive, out, request())
    assert first.exit_code == 0
    assert states(first) == ALL_RAN
    assert set(reasons(first).values()) == {"never ran"}
    assert (out / "double.txt").read_text() == "4"
    assert visible(out) == {"lines.txt", "double.txt", "story.txt", "run.json", "automap.log"}
    second = run_drive(drive, out, request())
    assert states(second) == ALL_KEPT
    assert second.stages[0].result == "2 lines"


def test_the_record_is_the_lineage(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    content = record(out)
    assert content["status"] == "done"
    assert content["command"] == "automap run drive"
    assert content["drive"] == {"name": "drive", "path": str(drive)}
    assert content["metrics"] == {"n_lines": 2}
    assert content["warnings"] == ["doubling is not an estimate"]
    assert set(content["inputs"]) == {"imu.csv"}  # type: ignore[call-overload]
    assert content["settings"] == load_settings().echo()
    stage = content["stages"]["detect"]  # type: ignore[index]
    assert stage["reason"] == "never ran"
    assert set(stage["outputs"]) == {"double.txt"}
    # the report stage saw the record of the stages before it
    story = json.loads((out / "story.txt").read_text())
    assert story["status"] == "running"
    assert story["stages"]["detect"]["status"] == "done"
    assert story["warnings"] == ["doubling is not an estimate"]


@pytest.mark.parametrize(("state", "told"), [("doubtful", ", for 1 reason:"), ("good", "")])
def test_the_verdict_of_the_path_is_the_runs_and_is_kept(
    drive: Path, out: Path, state: str, told: str
) -> None:
    verdict = {"state": state, "reasons": [{"code": "x", "text": "it is late"}]}

    def judge(context: StageContext) -> None:
        context.verdict = verdict

    for of_stage in ("ran", "kept"):
        outcome = run_drive(drive, out, request([reader(), doubler(judge), teller()]))
        assert states(outcome)["detect"] == of_stage
        assert record(out)["verdict"] == verdict
        lines = summary_lines(outcome)
        assert f"  verdict     {state}{told}" in lines
        assert any(line.strip() == "- it is late" for line in lines)
    assert run_drive(drive, out / "none", request([reader()])).record["verdict"] is None


def test_a_touched_input_with_the_same_content_changes_nothing(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    imu = drive / "imu.csv"
    imu.write_bytes(imu.read_bytes())
    (drive / "drive.toml").write_text('# a remark\nschema = "automap.drive/1"\nname = "x"\n')
    assert states(run_drive(drive, out, request())) == ALL_KEPT


def test_a_changed_input_runs_what_depends_on_it(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    with (drive / "imu.csv").open("a") as stream:
        stream.write("1,0,0,0,0,0,-9.8\n")
    again = run_drive(drive, out, request())
    assert reasons(again) == {
        "ingest": "imu.csv changed",
        "detect": "stage ingest ran again",
        "report": "stage detect ran again",
    }
    assert (out / "double.txt").read_text() == "6"


def test_the_same_result_stops_the_cascade(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    (drive / "imu.csv").write_text("two\nlines\n")
    again = run_drive(drive, out, request())
    assert states(again) == {"ingest": "ran", "detect": "kept", "report": "ran"}


def test_a_section_of_the_manifest_counts_where_it_is_used(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    (drive / "drive.toml").write_text('schema = "automap.drive/1"\n[imu]\naxes = "FLU"\n')
    again = run_drive(drive, out, request())
    assert reasons(again)["ingest"] == "drive.toml imu.axes is new"
    assert states(again)["detect"] == "kept"


def test_a_changed_setting_is_named_and_stale_outputs_go(drive: Path, out: Path) -> None:
    run_drive(drive, out, request(assignments=["detect.min_score=0.9"]))
    assert (out / "extra.txt").exists()
    again = run_drive(drive, out, request(assignments=["detect.min_score=0.4"]))
    assert states(again)["ingest"] == "kept"
    assert reasons(again)["detect"] == "settings detect.min_score changed from 0.9 to 0.4"
    assert not (out / "extra.txt").exists()


@pytest.mark.parametrize("edit", ["missing", "was changed"])
def test_an_output_that_is_not_what_was_written_is_made_again(
    drive: Path, out: Path, edit: str
) -> None:
    run_drive(drive, out, request())
    if edit == "missing":
        (out / "double.txt").unlink()
    else:
        (out / "double.txt").write_text("5")
    again = run_drive(drive, out, request())
    assert reasons(again)["detect"] == f"output double.txt {'is ' * (edit == 'missing')}{edit}"
    assert (out / "double.txt").read_text() == "4"


def test_a_new_version_runs_the_stage(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    again = run_drive(drive, out, request((reader(version=2), doubler(), teller())))
    assert reasons(again)["ingest"] == "version 1 -> 2"


def test_force_runs_everything(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    assert states(run_drive(drive, out, request(force=True))) == ALL_RAN


def test_a_dry_run_says_why_and_writes_nothing(drive: Path, out: Path) -> None:
    planned = run_drive(drive, out, request(dry_run=True))
    assert set(states(planned).values()) == {"would run"}
    assert not out.exists()
    run_drive(drive, out, request())
    before = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    planned = run_drive(drive, out, request(dry_run=True, assignments=["detect.min_score=0.4"]))
    assert states(planned) == {"ingest": "kept", "detect": "would run", "report": "would run"}
    assert reasons(planned)["report"] == "stage detect would run again"
    assert {path.name: path.stat().st_mtime_ns for path in out.iterdir()} == before


def test_a_selection_runs_alone_and_says_what_is_out_of_date(drive: Path, out: Path) -> None:
    refused = run_drive(drive, out, request(selected=["detect"]))
    assert isinstance(refused.error, ConfigError)
    assert "--from ingest" in str(refused.error)
    run_drive(drive, out, request())
    (drive / "imu.csv").write_text("one line\n")
    notes: list[str] = []

    class Listening(Reporter):
        def note(self, text: str) -> None:
            notes.append(text)

    alone = run_drive(drive, out, request(selected=["detect"], force=True), Listening())
    assert states(alone) == {"detect": "ran"}
    assert notes[0] == "stage ingest is out of date, but not selected: imu.csv changed"
    # what is made from it is now older than it
    assert [text.split(",")[0] for text in notes[1:]] == ["stage report is out of date"]
    # a command knows the later stages too
    asked = requested(None, (), ("export", None, None), force=False, dry_run=False, command=())
    assert [stage.name for stage in asked.stages][-2:] == ["export", "report"]


def fail_with(error: BaseException) -> Stage:
    def action(context: StageContext) -> None:
        raise error

    return doubler(action)


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (InputError("imu.csv, line 3: no number"), 3, "imu.csv, line 3: no number"),
        (ZeroDivisionError("by zero"), 4, "ZeroDivisionError"),
        (MemoryError(), 4, "memory"),
        (OSError(errno.ENOSPC, "No space left on device", "big.bin"), 4, "disk is full"),
        (OSError(errno.EIO, "Input/output error", "x.mp4"), 4, "x.mp4: Input/output error"),
    ],
)
def test_a_failure_is_one_sentence_and_leaves_nothing_half_written(
    drive: Path, out: Path, error: BaseException, code: int, text: str
) -> None:
    failed = run_drive(drive, out, request((reader(), fail_with(error), teller())))
    assert failed.exit_code == code
    assert text in str(failed.error)
    assert states(failed) == {"ingest": "ran", "detect": "failed"}
    assert visible(out) == {"lines.txt", "run.json", "automap.log"}
    assert record(out)["status"] == "failed"
    again = run_drive(drive, out, request())
    assert states(again) == {"ingest": "kept", "detect": "ran", "report": "ran"}
    assert reasons(again)["detect"] == "failed last time"


def test_a_full_disk_is_told(drive: Path, out: Path) -> None:
    def fill(context: StageContext) -> None:
        with Path("/dev/full").open("w") as stream:
            stream.write("x")

    failed = run_drive(drive, out, request((reader(), doubler(fill))))
    assert failed.exit_code == 4
    assert "the disk is full" in str(failed.error)
    assert "detect.tmp" not in visible(out)


def test_a_log_that_cannot_be_written_does_not_stop_a_run(
    drive: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AUTOMAP_ALLOW_OUTSIDE", "/dev")
    out.mkdir()
    (out / "automap.log").symlink_to("/dev/full")
    assert run_drive(drive, out, request()).exit_code == 0


def test_an_interrupt_leaves_and_the_next_run_resumes(drive: Path, out: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_drive(drive, out, request((reader(), fail_with(KeyboardInterrupt()), teller())))
    assert visible(out) == {"lines.txt", "run.json", "automap.log"}
    assert record(out)["status"] == "interrupted"
    again = run_drive(drive, out, request())
    assert reasons(again)["detect"] == "was interrupted"


def test_an_interrupt_as_a_stage_begins_leaves_no_folder(
    drive: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(path: Path) -> Path:
        path.mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr(execute, "make_folder", made)
    with pytest.raises(KeyboardInterrupt):
        run_drive(drive, out, request())
    assert not list(out.glob("*.tmp"))


def test_an_interrupt_as_a_stage_ends_leaves_no_folder(
    drive: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    remove, interrupts = shutil.rmtree, [KeyboardInterrupt()]

    def interrupted(path: Path, ignore_errors: bool = False) -> None:
        if interrupts and path.exists():
            raise interrupts.pop()
        remove(path, ignore_errors=ignore_errors)

    monkeypatch.setattr(execute.shutil, "rmtree", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_drive(drive, out, request())
    assert not list(out.glob("*.tmp"))


def test_a_killed_run_resumes(drive: Path, out: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path\n"
        "from tests.unit.fake_stages import *; from tests.unit.test_runner import request\n"
        "from pipeline.run.runner import run_drive\n"
        "def wait(context): print('waiting', flush=True); time.sleep(60)\n"
        "run_drive(Path(sys.argv[1]), Path(sys.argv[2]),"
        " request((reader(), doubler(wait), teller())))\n"
    )
    root = Path(__file__).parents[2]
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(drive), str(out)], cwd=root, stdout=subprocess.PIPE
    )
    assert child.stdout is not None
    assert child.stdout.readline() == b"waiting\n"
    busy = run_drive(drive, out, request())
    assert isinstance(busy.error, ConfigError)
    assert "another automap run" in str(busy.error)
    child.kill()
    child.wait()
    child.stdout.close()
    assert (out / "detect.tmp" / "double.txt").exists()
    assert not (out / "double.txt").exists()
    again = run_drive(drive, out, request())
    assert reasons(again)["detect"] == "was interrupted"
    assert not (out / "detect.tmp").exists()


def test_a_stage_that_writes_something_undeclared_is_refused(drive: Path, out: Path) -> None:
    stray = doubler(lambda context: (context.work / "stray.txt").write_text("x") and None)
    failed = run_drive(drive, out, request((reader(), stray)))
    assert "stray.txt" in str(failed.error)
    assert visible(out) == {"lines.txt", "run.json", "automap.log"}


def test_values_that_json_lacks_become_null(drive: Path, out: Path) -> None:
    odd = reader(lambda context: context.metric("sd", float("nan")))
    run_drive(drive, out, request((odd,)))
    assert record(out)["metrics"] == {"sd": None, "n_lines": 2}


def test_a_damaged_record_is_as_good_as_none(drive: Path, out: Path) -> None:
    run_drive(drive, out, request())
    (out / "run.json").write_text('{"schema": ')
    (out / ".digests.json").write_text("[1, 2]")
    assert set(reasons(run_drive(drive, out, request())).values()) == {"never ran"}


def test_an_output_folder_that_cannot_be_is_told(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "out"):
        outcome = run_drive(drive, place, request())
        assert outcome.exit_code == 4
        assert str(place) in str(outcome.error)


def test_the_lock_is_gone_with_its_holder(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(ConfigError), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_one_bad_drive_does_not_stop_the_others(drive: Path, tmp_path: Path) -> None:
    other = make_drive(tmp_path / "other")
    bad = tmp_path / "bad"
    outcomes = run_drives([drive, bad, other], tmp_path / "maps", request(), Reporter())
    assert [outcome.exit_code for outcome in outcomes] == [0, 3, 0]
    assert (tmp_path / "maps" / "other" / "double.txt").exists()
    assert not (tmp_path / "maps" / "bad").exists()


def test_folders_of_several_drives_are_distinct(tmp_path: Path) -> None:
    drives = [tmp_path / "a" / "day", tmp_path / "b" / "day", tmp_path / "c"]
    assert out_folders(drives, tmp_path) == [tmp_path / n for n in ("day", "day-2", "c")]
    assert out_folders(drives[:1], tmp_path) == [tmp_path]
    assert out_folders(drives[:1], None) == [drives[0] / "_automap"]
    with pytest.raises(ConfigError, match="twice"):
        out_folders([drives[0], tmp_path / "b" / ".." / "a" / "day"], None)


def test_a_kept_run_reads_no_input_again(
    drive: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_drive(drive, out, request())
    time.sleep(0.01)

    def refuse(*args: object) -> None:
        raise AssertionError("a file was read although nothing had changed")

    monkeypatch.setattr("hashlib.file_digest", refuse)
    assert states(run_drive(drive, out, request())) == ALL_KEPT


@pytest.mark.parametrize("when", ["before it writes", "after the stage before"])
def test_a_removed_results_folder_fails_the_run(drive: Path, out: Path, when: str) -> None:
    def remove(context: StageContext) -> None:
        if when == "before it writes":
            shutil.rmtree(context.out)
        else:
            (context.out / "lines.txt").unlink()

    outcome = run_drive(drive, out, request((reader(), doubler(remove), teller())))
    assert outcome.exit_code == StageError.exit_code
    assert "removed while" in str(outcome.error)
    again = run_drive(drive, out, request())
    assert again.exit_code == 0
    assert (out / "lines.txt").is_file()
