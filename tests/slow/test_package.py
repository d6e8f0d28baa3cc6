"""The wheel holds all that the command needs."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_wheel_carries_configs_and_data(tmp_path: Path) -> None:
    # without isolation nothing is fetched; it needs the packages of requirements-build.lock
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed; requirements-build.lock names it")
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps"),
            *("--no-build-isolation", "--wheel-dir", str(tmp_path), str(ROOT)),
        ],
        check=True,
    )
    (wheel,) = tmp_path.glob("automap-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        carried = set(archive.namelist())
        archive.extractall(tmp_path / "unpacked")
    for folder, place in (
        ("configs", "pipeline/_configs"),
        ("automap", "automap"),
        ("pipeline", "pipeline"),
    ):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                assert f"{place}/{path.relative_to(ROOT / folder)}" in carried
    (points,) = [name for name in carried if name.endswith("entry_points.txt")]
    assert "automap = pipeline.cli:main" in (tmp_path / "unpacked" / points).read_text()
    # the unpacked wheel works by itself, away from the checkout
    code = (
        "from pipeline.settings.load import configs_dir, load_settings; load_settings();"
        "print(configs_dir())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path / "unpacked",
        env={"PYTHONPATH": str(tmp_path / "unpacked")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()) == tmp_path / "unpacked" / "pipeline" / "_configs"
