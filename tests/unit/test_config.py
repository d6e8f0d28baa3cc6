"""The configuration: defaults, overlays, and what is said of a wrong key or value."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from automap.errors import ConfigError
from pipeline.settings.load import Settings, configs_dir, known_keys, load_settings

DEFAULTS = configs_dir() / "default.toml"


def test_the_file_of_defaults_and_the_classes_agree() -> None:
    stated = Settings.model_validate(tomllib.loads(DEFAULTS.read_text(encoding="utf-8")))
    assert stated.echo() == Settings().echo()


def test_every_setting_stands_in_the_file_of_defaults_with_a_comment() -> None:
    lines = DEFAULTS.read_text(encoding="utf-8").splitlines()
    for key in known_keys():
        if "." not in key:
            assert f"[{key}]" in lines
            continue
        name = re.escape(key.rsplit(".", 1)[1])
        stated = [line for line in lines if re.match(rf"{name}\s*=", line)]
        assert stated, f"{key} is missing from configs/default.toml"
        assert any("#" in line for line in stated), f"{key} has no unit in its comment"


def test_every_setting_is_used() -> None:
    root = Path(__file__).parents[2]
    own = {root / "pipeline" / "settings" / f"{name}.py" for name in Settings.model_fields}
    sources = [p for p in (root / "pipeline").rglob("*.py") if p not in own]
    # the fuse section becomes the fusion's options as a whole
    sources += (root / "automap" / "fusion").rglob("*.py")
    text = "\n".join(p.read_text(encoding="utf-8") for p in sources)
    unused = [key for key in known_keys() if "." in key and f".{key.rsplit('.', 1)[1]}" not in text]
    assert unused == []


def test_a_file_then_assignments_replace_single_values(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[detect]\nmin_score = 0.5\nframes_per_s = 2.0\n")
    settings = load_settings(path, ["detect.min_score=0.75"])
    assert settings.detect.min_score == 0.75
    assert settings.detect.frames_per_s == 2.0
    assert settings.sync == Settings().sync


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("detect.min_scor=1", "detect.min_score"),
        ("min_score=1", "detect.min_score"),
        ("detekt.min_score=1", "detect"),
        ("detect.min_score=high", "not accepted"),
        ("detect.min_score=nan", "not accepted"),
        ("detect.min_score=7", "not accepted"),
        ("detect=7", "section"),
        ("detect.min_score", "SECTION.KEY=VALUE"),
        ("=3", "SECTION.KEY=VALUE"),
    ],
)
def test_a_wrong_assignment_is_told_with_its_text(assignment: str, expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_settings(None, [assignment])
    assert assignment in str(caught.value)
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"[detect]\nminscore = 1\n", "detect.min_score"),
        (b"[detect\n", "line 1"),
        (b"[detect]\nx = \xff\n", "UTF-8"),
        (b"detect = 3\n", "section"),
    ],
)
def test_a_wrong_file_is_named(tmp_path: Path, content: bytes, expected: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load_settings(path)
    assert str(path) in str(caught.value)
    assert expected in str(caught.value)


def test_a_missing_file_and_a_folder_are_told(tmp_path: Path) -> None:
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(ConfigError, match=re.escape(str(path))):
            load_settings(path)
