"""The declarations of the stages fit together."""

from __future__ import annotations

import pytest

from automap.errors import ConfigError
from automap.io import names
from pipeline.run.registry import ORDER, load_stages, select
from pipeline.settings.load import Settings


def test_no_file_has_two_writers_and_every_need_is_written_earlier() -> None:
    written: dict[str, str] = {}
    outside = {names.RUN, names.EVALUATION, names.REVIEW}
    for stage in load_stages():
        unknown = set(stage.needs) - written.keys() - outside
        assert not unknown, f"{stage.name} needs {unknown}, which no earlier stage writes"
        for output in stage.outputs:
            assert output not in written, f"{output}: {stage.name} and {written[output]}"
            assert output != names.RUN
            written[output] = stage.name


def test_every_section_named_by_a_stage_exists() -> None:
    for stage in load_stages():
        assert set(stage.settings) <= set(Settings.model_fields)


def test_ranges() -> None:
    assert select() == ORDER
    assert select(only="fuse") == ("fuse",)
    assert select(first="detect") == ("detect", "geolocate", "export", "report")
    assert select(last="sync") == ("ingest", "sync")
    assert select(first="sync", last="sync") == ("sync",)
    with pytest.raises(ConfigError, match="--only"):
        select(only="fuse", last="fuse")
    with pytest.raises(ConfigError, match="comes after"):
        select(first="report", last="ingest")
