"""Modules that commands import and kernels that they compile, loaded before processes fork."""

from __future__ import annotations

import contextlib
import io
import tempfile
from pathlib import Path

from tests.faults.commands import SCENES


def warm(names: tuple[str, ...] = ("run", "calibrate")) -> None:
    """Run scenes in this process: what they leave in memory is what forked ones start with."""
    from pipeline.cli.root import run_command

    for name in names:
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            SCENES[name].make(Path(folder), 0)
            if code := run_command(SCENES[name].command(Path(folder), Path(folder) / "out")):
                raise RuntimeError(f"{name} fails by itself with exit code {code}")
