"""Drives as tests: a plugin for pytest, at work where its configuration names drives.

    [tool.pytest.ini_options]
    automap_drives = ["drives/*"]

Each folder that the patterns match is a test: the drive is run afresh and compared with its
stored figures, as ``automap regress`` does. Only pytest and the standard library are imported
until one runs.
"""

from __future__ import annotations

import glob
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_DRIVES = "automap_drives"
_BASELINE = "automap_baseline"
_WORK = "automap_work"
_MANIFEST = "drive.toml"


class DriveMovedError(Exception):
    """A drive's figures moved, or it could not be run; the text is the table."""


class DriveTest(pytest.Item):
    """A drive run and compared with its stored figures."""

    def __init__(self, *, drive: Path, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.drive = drive

    def runtest(self) -> None:
        """Run the drive; raises DriveMovedError with the table of what moved."""
        from pipeline.regress.command import Request, regress
        from pipeline.regress.table import lines_of
        from pipeline.settings.load import load_settings

        baseline = self.config.rootpath / self.config.getini(_BASELINE)
        work = self.config.rootpath / self.config.getini(_WORK)
        request = Request(
            drives=(self.drive,),
            baseline=baseline,
            # a page of its own for each drive, for tests may run side by side
            work=work / self.drive.name,
            settings=load_settings(),
        )
        session = regress(request)
        if session.exit_code:
            lines = [line for result in session.results for line in lines_of(result)]
            raise DriveMovedError("\n".join([*lines, str(session.page)]))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> str:
        """The table, or the sentence of an expected failure, without a traceback."""
        from automap.errors import AutoMapError

        if isinstance(excinfo.value, DriveMovedError | AutoMapError):
            return str(excinfo.value)
        return str(super().repr_failure(excinfo, style))

    def reportinfo(self) -> tuple[Path, None, str]:
        """Where the test is from and what it is called."""
        return self.drive / _MANIFEST, None, f"drive {self.drive.name}"


class DriveFile(pytest.File):
    """The manifest of a drive that the configuration names."""

    def collect(self) -> Iterator[DriveTest]:
        """The one test of the drive."""
        yield DriveTest.from_parent(self, name="regress", drive=self.path.parent)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The settings of the plugin in pytest's configuration."""
    parser.addini(_DRIVES, "Patterns of drive folders that are tests.", "args", default=[])
    parser.addini(
        _BASELINE, "File with the drives' stored figures.", default="automap-baseline.json"
    )
    parser.addini(_WORK, "Folder for the runs of the drives.", default="_regress")


def _drives(config: pytest.Config) -> list[Path]:
    """The folders that the configuration names and that are drives, in order."""
    found: dict[Path, None] = {}
    for pattern in config.getini(_DRIVES):
        for text in sorted(glob.glob(str(config.rootpath / pattern))):
            path = Path(text)
            folder = path.parent if path.name == _MANIFEST else path
            if (folder / _MANIFEST).is_file():
                found[folder.resolve()] = None
    return list(found)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> DriveFile | None:
    """A manifest met on the way, where it is one of the configuration's drives."""
    if file_path.name == _MANIFEST and file_path.parent.resolve() in _drives(parent.config):
        collector: DriveFile = DriveFile.from_parent(parent, path=file_path)
        return collector
    return None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(
    session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Add the drives that lie where pytest did not look, unless it was told where to look."""
    if config.args_source is pytest.Config.ArgsSource.ARGS:
        return
    have = {item.drive.resolve() for item in items if isinstance(item, DriveTest)}
    for drive in _drives(config):
        if drive not in have:
            file = DriveFile.from_parent(session, path=drive / _MANIFEST)
            items += list(file.collect())
