"""The configuration: defaults, overlays, and what is said of a wrong key or value."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from automap.errors import ConfigError
from automap.fusion.options import FusionOptions
from automap.geolocation.rules import GeolocationRules
from automap.io.imu_csv import read_imu_csv
from automap.io.manifest import read_manifest
from automap.io.recording import read_recording
from automap.sync.arrival import fit_arrival_clock
from automap.sync.motion_clock import correlation_clock
from pipeline.run.stages.geolocate import rules_from
from pipeline.settings.defaults import default_toml
from pipeline.settings.load import Settings, known_keys, load_settings
from pipeline.shared.configs import configs_dir

DEFAULTS = configs_dir() / "default.toml"


def test_the_file_of_defaults_is_made_of_the_classes() -> None:
    text = DEFAULTS.read_text(encoding="utf-8")
    assert text == default_toml(), "run python -m pipeline.settings.defaults"
    assert Settings.model_validate(tomllib.loads(text)).echo() == Settings().echo()


def test_every_setting_has_a_comment() -> None:
    settings = Settings()
    for section in Settings.model_fields:
        for name, info in type(getattr(settings, section)).model_fields.items():
            assert info.description, f"{section}.{name} has no text below its field"


def test_the_library_left_alone_does_what_the_settings_say() -> None:
    def default(function: Callable[..., object], name: str) -> object:
        return inspect.signature(function).parameters[name].default

    settings = Settings()
    assert settings.fuse.options() == FusionOptions()
    assert rules_from(settings.geolocate, "") == GeolocationRules()
    assert default(read_recording, "gap_factor") == settings.ingest.gap_factor
    assert default(read_imu_csv, "gap_factor") == settings.ingest.gap_factor
    assert FusionOptions().gap_factor == settings.ingest.gap_factor
    drift_sd = pytest.approx(settings.sync.drift_sd_ppm * 1e-6)
    assert default(correlation_clock, "drift_sd") == drift_sd
    assert default(fit_arrival_clock, "drift_sd") == drift_sd


def test_every_setting_is_used() -> None:
    root = Path(__file__).parents[2]
    own = {root / "pipeline" / "settings" / f"{name}.py" for name in Settings.model_fields}
    sources = [p for p in (root / "pipeline").rglob("*.py") if p not in own]
    # the fuse section becomes the fusion's options as a whole; an effect names its own walk, and
    # an error that lasts its size and time
    sources += [
        *(root / "automap" / "fusion").rglob("*.py"),
        *(root / "automap" / "effects").rglob("*.py"),
    ]
    text = "\n".join(p.read_text(encoding="utf-8") for p in sources)
    by_name = r'walk_setting="|GaussMarkov\([^)]*"'
    unused = [
        key
        for key in known_keys()
        if "." in key and not re.search(rf"(\.|{by_name}){key.rsplit('.', 1)[1]}\b", text)
    ]
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
        ("geolocate.pixel_sd=true", "no numbers"),
        ("geolocate.sign_size_m=false", "no numbers"),
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


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("width = true", "no numbers"),
        ("lever_arm_m = [0.0, true, 0.0]", "no numbers"),
        ("time_offset_s = 1", ""),
    ],
)
def test_true_is_no_number_in_a_manifest(line: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.toml"
    path.write_text(f'schema = "automap.drive/1"\n[video.front]\n{line}\n')
    if not told:
        assert read_manifest(path).video["front"].time_offset_s == 1.0
        return
    with pytest.raises(ConfigError, match=told):
        read_manifest(path)
