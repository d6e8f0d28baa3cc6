"""``automap regress`` around the runs: what is asked, told, stored and collected."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from automap.regression.record import DriveRecord, to_json
from pipeline.cli.root import run_command
from pipeline.regress import command
from pipeline.regress.baseline import read_baseline, write_baseline
from pipeline.regress.page import page_html
from pipeline.regress.session import DriveResult
from pipeline.regress.table import lines_of
from pipeline.settings.load import load_settings
from tests.unit.test_regress_figures import record, trajectory

pytest_plugins = ("pytester",)


def drive(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "drive.toml").write_text('schema = "automap.drive/1"\n')
    return folder


def result(name: str, then: DriveRecord | None, now: DriveRecord | None) -> DriveResult:
    from automap.regression.change import Tolerance
    from automap.regression.record import compare

    changes = []
    if then is not None and now is not None:
        changes = compare(then, now, trajectory(), Tolerance())
    code = 3 if now is None else 5 if any(c.moved for c in changes) else 0
    error = "" if now is not None else "imu.csv is broken."
    return DriveResult(name, Path(name), Path(name), code, error, then, now, tuple(changes))


def other() -> DriveRecord:
    from dataclasses import replace

    return replace(record(), sync={"offset_s": (1.0e9 + 0.125, 3e-4)}, counts={"fixes": 80})


def test_a_drive_without_stored_figures_is_refused_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = drive(tmp_path / "d")
    code = run_command(["regress", str(path), "--baseline", str(tmp_path / "b.json")])
    assert code == 2
    assert "--update" in capsys.readouterr().err
    assert not (tmp_path / "_regress").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--yes"], "--update"),
        (["--update"], "--yes"),
        (["--tolerance", "0"], "--tolerance"),
        (["--jobs", "0"], "--jobs"),
    ],
)
def test_wrong_usage(
    tmp_path: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["regress", str(drive(tmp_path / "d")), *arguments]) == 2
    assert said in capsys.readouterr().err


def test_two_drives_of_one_name_and_a_damaged_baseline(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = drive(tmp_path / "x" / "d"), drive(tmp_path / "y" / "d")
    assert run_command(["regress", str(a), str(b)]) == 2
    assert "called d" in capsys.readouterr().err
    (tmp_path / "b.json").write_text("{")
    assert run_command(["regress", str(a), "--baseline", str(tmp_path / "b.json")]) == 3


@pytest.mark.slow
def test_a_drive_that_cannot_be_run_keeps_its_figures(tmp_path: Path) -> None:
    path, baseline = drive(tmp_path / "d"), tmp_path / "b.json"
    write_baseline(baseline, {"d": record(), "e": record()})
    before = read_baseline(baseline)
    arguments = ["regress", str(path), "--baseline", str(baseline)]
    assert run_command(arguments) == 3
    assert run_command([*arguments, "--update", "--yes"]) == 3
    assert {k: to_json(v) for k, v in read_baseline(baseline).items()} == {
        k: to_json(v) for k, v in before.items()
    }
    assert "failed" in (tmp_path / "_regress" / "regress.html").read_text()
    told = json.loads((tmp_path / "_regress" / "regress.json").read_text())
    assert told["exit_code"] == 3


def test_the_table_names_what_moved_and_by_how_much() -> None:
    lines = lines_of(result("d", record(), other()))
    assert lines[0].startswith("d: 2 of ")
    text = "\n".join(lines)
    assert "fixes" in text
    assert "2.00 σ" in text
    assert "offset_s" in text
    assert "accel_bias_x" not in text
    assert "accel_bias_x" in "\n".join(lines_of(result("d", record(), other()), everything=True))
    assert lines_of(result("d", record(), record()))[0].startswith("d: same")


def test_the_page_holds_both_maps_and_escapes_names() -> None:
    results = [
        result("<b>a</b>", record(), other()),
        result("b", record(), record()),
        result("c", None, record()),
        result("d", record(), None),
    ]
    page = page_html(results)
    assert "<b>a</b>" not in page
    assert page.count('class="overlay"') == 4
    assert "imu.csv is broken." in page
    assert "http://" not in page.split("<script")[0]
    maps = json.loads(page.split('id="maps">')[1].split("</script>")[0])
    # drives that failed or moved come first
    assert maps[0]["now"] is None
    assert maps[1]["then"]["path"] == maps[1]["now"]["path"]
    assert maps[1]["then"]["signs"][0]["name"].endswith("stop--g1")


def test_storing_says_what_it_changes_and_leaves_other_drives(tmp_path: Path) -> None:
    baseline = tmp_path / "b.json"
    write_baseline(baseline, {"a": record(), "z": record()})
    results = (result("a", record(), other()), result("new", None, record()))
    session = command.Session(results, tmp_path / "page.html")
    assert session.exit_code == 5
    assert session.question == "This stores first figures of new and figures that moved of a."
    request = command.Request((), baseline, None, load_settings())
    assert command.store(session, request) == f"stored 2 drives in {baseline}"
    stored = read_baseline(baseline)
    assert sorted(stored) == ["a", "new", "z"]
    assert stored["a"].counts == {"fixes": 80}


def collected(pytester: pytest.Pytester, *arguments: str) -> list[str]:
    out = pytester.runpytest_subprocess(
        "--collect-only", "-q", "-p", "no:cacheprovider", *arguments
    )
    return [line for line in out.outlines if "regress" in line]


@pytest.mark.slow
def test_the_plugin_makes_a_test_of_each_drive(pytester: pytest.Pytester) -> None:
    for name in ("golf-01", "golf-02"):
        drive(pytester.path / "drives" / name)
    (pytester.path / "drives" / "notes").mkdir()
    drive(pytester.path / "elsewhere")
    pytester.makepyprojecttoml(
        '[tool.pytest.ini_options]\nautomap_drives = ["drives/*"]\ntestpaths = ["tests"]\n'
    )
    (pytester.path / "tests").mkdir()
    (pytester.path / "tests" / "test_one.py").write_text("def test_one(): pass\n")
    both = [f"drives/golf-0{n}/drive.toml::regress" for n in (1, 2)]
    assert collected(pytester) == both
    assert collected(pytester, "drives/golf-02") == both[1:]
    assert collected(pytester, "tests") == []
    assert collected(pytester, "-k", "golf-01") == both[:1]


@pytest.mark.slow
def test_the_plugin_tells_in_a_sentence_what_failed(pytester: pytest.Pytester) -> None:
    drive(pytester.path / "drives" / "golf-01")
    pytester.makepyprojecttoml('[tool.pytest.ini_options]\nautomap_drives = ["drives/*"]\n')
    out = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    out.assert_outcomes(failed=1)
    out.stdout.fnmatch_lines(["*has no figures of golf-01*--update*"])
    assert "Traceback" not in out.stdout.str()


def test_without_the_setting_nothing_is_collected(pytester: pytest.Pytester) -> None:
    drive(pytester.path / "drives" / "golf-01")
    assert collected(pytester) == []


def test_a_drive_that_is_not_there_is_told_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    absent, baseline = tmp_path / "golf-99", tmp_path / "base.json"
    assert run_command(["regress", str(absent), "--baseline", str(baseline)]) == 2
    assert f"{absent}: there is no such drive folder" in capsys.readouterr().err
