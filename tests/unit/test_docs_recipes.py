"""The recipes of CONTRIBUTING.md work as they stand there."""

from __future__ import annotations

import importlib
import importlib.util
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pydantic
import pytest
from export_inputs import write_run

from automap.effects import CATALOGUE, distort_imu, imu_terms
from automap.effects.entries import inertial, receiver
from automap.effects.measured import distortion, measured_terms
from automap.effects.terms import VELOCITY
from automap.fusion import layout
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from automap.io.trajectory_table import read_trajectory
from pipeline.cli import import_kinds, root
from pipeline.cli.root import run_command
from pipeline.export import formats
from tests.docs_commands import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r'^```python title="([^"]+)"\n(.*?)^```', TEXT, re.MULTILINE | re.DOTALL)


def entries(place: str) -> list[str]:
    """What the page adds to a table or class, or to a module that exists."""
    found = [code for title, code in BLOCKS if title == place]
    assert found, place
    return found


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The new modules of the page can be imported; a folder to work in."""
    monkeypatch.setattr(layout, "FLAT", 128, raising=False)
    monkeypatch.setattr(layout, "CH_FLAT", 15, raising=False)
    for title, code in BLOCKS:
        if not (ROOT / title).exists() and ":" not in title:
            load(title, code, tmp_path, monkeypatch)
    return tmp_path


def load(title: str, code: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A module of the page, from a file of its own: compiled code is kept beside it."""
    name = title.removesuffix(".py").replace("/", ".")
    path = folder / title
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(code, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    package = name.rpartition(".")[0]
    if importlib.util.find_spec(package) is None:
        made = ModuleType(package)
        made.__path__ = []
        monkeypatch.setitem(sys.modules, package, made)
    monkeypatch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    return module


def evaluated(code: str, module: ModuleType) -> Any:
    return eval(code, dict(vars(module)))


def test_a_recording_of_another_program(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = entries("pipeline/cli/import_kinds.py: KINDS")
    kind = evaluated(code, import_kinds)
    monkeypatch.setitem(import_kinds.KINDS, kind.name, kind)
    rows = [f"{1.7e9 + i},{48.1 + 1e-5 * i:.6f},11.5,{500 + i}" for i in range(5)]
    text = "\n".join(["unix_s,lat,lon,height", *rows, "1700000009,north,11.5,500"])
    (page / "ride.csv").write_text(text + "\n", encoding="utf-8")
    assert run_command(["import", "bike", str(page / "ride.csv"), "-o", str(page / "ride")]) == 0
    fixes = read_recording(load_drive(page / "ride")).fixes
    assert fixes is not None
    assert np.degrees(fixes.lat_rad) == pytest.approx(48.1 + 1e-5 * np.arange(5), abs=1e-7)
    assert fixes.height_m == pytest.approx(500.0 + np.arange(5))
    (page / "broken.csv").write_text("no,table\n", encoding="utf-8")
    assert run_command(["import", "bike", str(page / "broken.csv"), "-o", str(page / "x")]) == 3
    assert run_command(["import", "bike", "--help"]) == 0


def test_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, table in ((inertial, "INERTIAL"), (receiver, "RECEIVER")):
        for code in entries(
            f"automap/effects/entries/{module.__name__.split('.')[-1]}.py: {table}"
        ):
            effect = evaluated(code, module)
            monkeypatch.setitem(CATALOGUE, effect.name, effect)
    rng = np.random.default_rng(4)
    gyro, accel = rng.normal(0.0, 0.4, (9, 3)), rng.normal(0.0, 2.0, (9, 3))
    rates, forces = distort_imu(gyro, accel, {"gyro_quadratic": {"y": 0.01}})
    assert rates - gyro == pytest.approx(0.01 * gyro**2 * [0.0, 1.0, 0.0])
    assert np.array_equal(forces, accel)
    assert len(imu_terms(["gyro_quadratic"])) == 3
    acting = distortion({"gnss_velocity_scale": {"relative": 0.02}}, VELOCITY, 1, lambda name: name)
    assert acting.longer == pytest.approx([1.02, 1.02, 1.02])
    terms, signals = measured_terms({"gnss_velocity_scale": 0})
    assert [len(table.weights) for table in terms] == [0, 3, 0]
    assert signals == ()


def test_a_measurement(page: Path) -> None:
    module = sys.modules["automap.fusion.measurements.flat_road"]
    flags, var = np.zeros(2, dtype=np.int64), np.ones((2, 16))
    module.note_flat(flags, var, np.array([1.0, 0.5]), 0.2)
    assert var[:, 15] == pytest.approx([0.04, 0.08])

    class At:
        vel = np.array([9.0, 1.0, 0.3])

    class Nodes:
        pass

    Nodes.flags = flags  # type: ignore[attr-defined]
    h, z = np.full((3, 12), np.nan), np.zeros(3)
    assert module.flat_road.py_func(Nodes, 0, At, None, h, z) == (1, 15)
    assert z[0] == pytest.approx(-0.3)
    assert np.flatnonzero(h[0]).tolist() == [5]
    flags[0] = 0
    assert module.flat_road.py_func(Nodes, 0, At, None, h, z) == (0, 0)


def test_an_export_format(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formats, "FORMATS", dict(formats.FORMATS))
    (code,) = entries("pipeline/export/formats.py")
    exec(code, vars(formats))
    monkeypatch.setattr("pipeline.export.command.FORMATS", formats.FORMATS)
    out = write_run(page / "out", signs=4)
    assert run_command(["export", str(out), "--format", "wkt"]) == 0
    lines = (out / "signs.wkt").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 4
    assert all(re.fullmatch(r"POINT Z \(8\.\d{7} 4\d\.\d{7} \d+\.\d\d\)", line) for line in lines)


def test_a_setting(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = entries("pipeline/settings/report.py: ReportSettings")
    # a module of its own, for the text below a field is found in the source of its class
    module = load(
        "pipeline/settings/mine.py",
        "from pydantic import Field\n\nfrom pipeline.settings.section import Section\n\n\n"
        "class Mine(Section):\n" + textwrap.indent(code, "    "),
        page,
        monkeypatch,
    )
    ((name, info),) = module.Mine.model_fields.items()
    assert info.description
    with pytest.raises(pydantic.ValidationError):
        module.Mine(**{name: 1})


def test_a_command(page: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setitem(root._COMMANDS, "length", "pipeline.cli.length")
    out = write_run(page / "out", signs=1)
    assert run_command(["length", str(out)]) == 0
    trajectory = read_trajectory(out / "trajectory.parquet")
    seconds = float(trajectory.t_ns[-1] - trajectory.t_ns[0]) * 1e-9
    assert float(capsys.readouterr().out) == pytest.approx(12.0 * seconds, rel=1e-3)
    assert run_command(["length", str(page)]) == 3
    assert run_command(["length", "--help"]) == 0
    assert "Example" in capsys.readouterr().out


def test_make_has_the_targets_that_are_named() -> None:
    targets = set(re.findall(r"^make (\w+)$", TEXT, re.MULTILINE))
    assert {"test", "check"} <= targets
    for target in targets:
        subprocess.run(["make", "--dry-run", target], cwd=ROOT, check=True, capture_output=True)


def test_linked_files_exist() -> None:
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", TEXT)]
    assert len(links) > 2
    assert [link for link in links if not (ROOT / link).is_file()] == []
