"""The command line: exit codes, one sentence per failure, help that is quick and complete."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest

from automap import __version__
from automap.errors import InputError
from pipeline.cli.root import _COMMANDS, cli, run_command
from pipeline.run import registry
from pipeline.run.stage import StageContext
from tests.unit.fake_stages import doubler, make_drive, reader, teller

ROOT = Path(__file__).parents[2]


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three fake stages in the place of the real ones."""
    stages = [reader(), doubler(), teller()]
    monkeypatch.setattr(registry, "load_stages", lambda names: stages)


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return make_drive(tmp_path / "drive")


@pytest.mark.parametrize("name", list(_COMMANDS))
def test_every_subcommand_has_help_with_an_example(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert re.search(rf"^  Examples?:\n    automap {name} ", text, re.MULTILINE)


def test_the_help_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["--help"]) == 0
    text = capsys.readouterr().out
    for name in _COMMANDS:
        assert re.search(rf"^  {name} +\w", text, re.MULTILINE)


def test_the_help_groups_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    """Every command once, below what it is for."""
    assert run_command(["--help"]) == 0
    text = capsys.readouterr().out
    groups = ["Set up", "Run", "Look", "Export", "Maintain"]
    starts = [text.index(f"\n{group}:\n") for group in groups]
    assert starts == sorted(starts)
    listed = re.findall(r"^  ([a-z]+)  +[A-Z]", text[starts[0] :], re.MULTILINE)
    assert listed == list(_COMMANDS)


def test_every_help_fits_a_terminal() -> None:
    def check(command: click.Command, context: click.Context) -> None:
        for line in command.get_help(context).splitlines():
            assert len(line) <= 80, f"{context.command_path}: {line}"
        for name in command.list_commands(context) if isinstance(command, click.Group) else ():
            inner = command.get_command(context, name)
            assert inner is not None
            check(inner, click.Context(inner, info_name=name, parent=context, terminal_width=80))

    check(cli, click.Context(cli, info_name="automap", terminal_width=80))


def test_a_shell_completes_commands_and_options(capsys: pytest.CaptureFixture[str]) -> None:
    from click.shell_completion import ShellComplete

    def completed(words: list[str], start: str) -> set[str]:
        complete = ShellComplete(cli, {}, "automap", "_AUTOMAP_COMPLETE")
        return {item.value for item in complete.get_completions(words, start)}

    assert completed([], "ch") == {"check"}
    assert "--dry-run" in completed(["run"], "--d")
    assert "rosbag" in completed(["import"], "ros")


def test_a_mistyped_command_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["exprot", "x"]) == 2
    assert "Did you mean export?" in capsys.readouterr().err


def test_help_tells_limits_only_where_there_are_some(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["experiment", "--help"]) == 0
    text = capsys.readouterr().out
    assert "[x>=1.0]" in text
    assert "None" not in text


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["--version"]) == 0
    assert __version__ in capsys.readouterr().out


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom pipeline.cli.root import run_command\n"
        "run_command(['--help'])\nrun_command(['run', '--help'])\n"
        "heavy = {'numpy', 'pydantic', 'pandas', 'numba', 'cv2', 'rich', 'pyarrow', 'scipy'}\n"
        "sys.exit(','.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.stderr.strip() == ""
    assert done.returncode == 0


@pytest.mark.parametrize(
    "words",
    [
        ["nothing"],
        ["run"],
        ["run", "x", "--only", "nothing"],
        ["run", "x", "--only", "fuse", "--to", "fuse"],
        ["run", "x", "--from", "export", "--to", "sync"],
        ["run", "x", "--set", "fuse.nothing=1"],
        ["run", "x", "--config", "nothing.toml"],
        ["simulate"],
    ],
)
def test_wrong_usage_is_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(words) == 2
    captured = capsys.readouterr()
    assert captured.err.strip()
    assert "Traceback" not in captured.err


@pytest.mark.usefixtures("fake")
def test_a_run_shows_its_stages_and_the_summary(
    drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["run", str(drive)]) == 0
    text = capsys.readouterr().out
    assert re.search(r"ingest +ran .*2 lines +\(never ran\)", text)
    assert "warning: doubling is not an estimate" in text
    assert "drive: 3 of 3 stages ran in " in text
    assert run_command(["run", str(drive), "--quiet"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.usefixtures("fake")
def test_json_is_one_object(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["run", str(drive), str(drive.parent / "none"), "--json"]) == 3
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert summary["exit_code"] == 3
    assert [entry["exit_code"] for entry in summary["drives"]] == [0, 3]
    assert summary["drives"][0]["metrics"] == {"n_lines": 2}
    assert "none" in summary["drives"][1]["error"]
    assert captured.err.count("\n") == 1


@pytest.mark.usefixtures("fake")
def test_a_dry_run_shows_reasons(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["run", str(drive), "--dry-run"]) == 0
    assert re.search(r"detect +would run .*\(stage ingest would run again", capsys.readouterr().out)


@pytest.mark.parametrize("key", ["verdict", "signs_verdict"])
@pytest.mark.parametrize(("state", "code"), [("good", 0), ("doubtful", 5), ("unusable", 5)])
def test_strict_tells_by_the_code_what_the_verdicts_are(
    state: str,
    code: int,
    key: str,
    drive: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def judge(context: StageContext) -> None:
        reasons = [] if state == "good" else [{"code": "late", "text": "fixes are 9 s late"}]
        setattr(context, key, {"state": state, "reasons": reasons})

    monkeypatch.setattr(registry, "load_stages", lambda names: [reader(), doubler(judge)])
    words = ["run", str(drive), "--to", "detect", "--strict"]
    for _ in ("ran", "kept"):
        assert run_command(words) == code
        captured = capsys.readouterr()
        assert (drive / "_automap" / "double.txt").exists()
        assert f"verdict     {state}" in captured.out
        assert ("fixes are 9 s late" in captured.err) == (code == 5)
    assert run_command([*words, "--quiet", str(drive.parent / "none")]) == max(code, 3)
    assert run_command([word for word in words if word != "--strict"]) == 0
    capsys.readouterr()
    assert run_command([*words, "--json"]) == code
    assert json.loads(capsys.readouterr().out)["drives"][0][key]["state"] == state


def failing(error: BaseException) -> list[object]:
    def action(context: StageContext) -> None:
        raise error

    return [reader(action)]


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (InputError("imu.csv is\nempty"), 3, "error: imu.csv is empty\n"),
        (ValueError("what"), 4, "run with --debug"),
    ],
)
def test_a_failure_is_a_sentence_and_debug_adds_the_traceback(
    drive: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    sentence: str,
) -> None:
    monkeypatch.setattr(registry, "load_stages", lambda names: failing(error))
    assert run_command(["run", str(drive)]) == code
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert "Traceback" not in captured.err
    for words in (["--debug", "run", str(drive)], ["run", str(drive), "--debug"]):
        assert run_command(words) == code
        assert "Traceback" in capsys.readouterr().err


def test_an_interrupt_is_130(
    drive: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "load_stages", lambda names: failing(KeyboardInterrupt()))
    assert run_command(["run", str(drive)]) == 130
    assert "interrupted" in capsys.readouterr().err


def test_a_command_that_keeps_nothing_starts_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.simulate.drive_writer.write_drive", interrupted)
    assert run_command(["simulate", "sample", "-o", str(tmp_path / "drive")]) == 130
    assert capsys.readouterr().err.strip() == "interrupted; the same command starts over"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_cleanly(drive: Path, number: signal.Signals) -> None:
    code = (
        # a shell that runs the tests in the background lets its children ignore the interrupt
        "import signal, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pipeline.cli import main\nfrom pipeline.run import registry\n"
        "from tests.unit.fake_stages import reader\n"
        "def wait(context): print('waiting', flush=True); time.sleep(60)\n"
        "registry.load_stages = lambda names: [reader(wait)]\n"
        f"main(['run', {str(drive)!r}, '--quiet'])\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "waiting\n"
    child.send_signal(number)
    _, told = child.communicate(timeout=30)
    assert child.returncode == 130
    assert told.strip() == "interrupted; the same command resumes"
    out = drive / "_automap"
    assert json.loads((out / "run.json").read_text())["status"] == "interrupted"
    assert not (out / "ingest.tmp").exists()


def test_an_unexpected_failure_of_a_command_is_4(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    @click.command("run")
    def broken() -> None:
        raise RuntimeError("no idea")

    monkeypatch.setattr(cli, "get_command", lambda ctx, name: broken)
    assert run_command(["run"]) == 4
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert "no idea" in captured.err


def test_warnings_of_a_truth_are_no_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import pipeline.evaluate.command

    result = {"n_compared": 3, "warnings": ["the truth contradicts itself."]}
    monkeypatch.setattr(pipeline.evaluate.command, "evaluate_run", lambda *a: result)
    assert run_command(["evaluate", str(tmp_path)]) == 0
    told = capsys.readouterr()
    assert "warning: the truth contradicts itself." in told.err
    assert "contradicts" not in told.out
    assert "n_compared" in told.out


def test_a_requirement_not_met_is_5(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import pipeline.evaluate.command

    monkeypatch.setattr(pipeline.evaluate.command, "evaluate_run", lambda *a: {"signs": {"n": 3.0}})
    words = ["evaluate", str(tmp_path)]
    assert run_command([*words, "--require", "signs.n>2"]) == 0
    assert run_command([*words, "--require", "signs.n>4"]) == 5
    assert "signs.n" in capsys.readouterr().err
    assert run_command([*words, "--require", "signs.m>4"]) == 2
