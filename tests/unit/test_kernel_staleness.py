"""Compiled code is not used when anything that it was compiled from has changed."""

from __future__ import annotations

import importlib.util
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import pytest
from numba.core.dispatcher import Dispatcher

from automap.jit import ROOT, sources_of

PACKAGE = ROOT / "automap"
KERNELS = sorted(
    path
    for path in PACKAGE.rglob("*.py")
    if re.search(r"^\s*from automap\.jit import kernel(_with)?$", path.read_text(), re.MULTILINE)
)
"""The modules that have functions of their own compiled."""


def _module(path: Path) -> ModuleType:
    return importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))


def _all_called(function: Any, found: set[Any]) -> set[Any]:
    """A compiled function and all compiled ones that it calls."""
    found.add(function)
    scope = function.py_func.__globals__
    for name in function.py_func.__code__.co_names:
        value = scope.get(name)
        if isinstance(value, Dispatcher) and value not in found:
            _all_called(value, found)
    return found


def test_there_are_kernels_in_every_package_that_had_some() -> None:
    packages = {path.relative_to(PACKAGE).parts[0] for path in KERNELS}
    assert {"calibration", "effects", "export", "fusion", "gap", "geolocation"} <= packages
    assert {"mapping", "io", "robust.py"} <= packages


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_what_a_kernel_is_compiled_from_is_watched(path: Path) -> None:
    """Every compiled function that a module's own ones call, and every module that it has a name
    from, be it of a constant."""
    watched = sources_of(path)
    module = _module(path)
    own = [
        value
        for value in vars(module).values()
        if isinstance(value, Dispatcher) and value.__module__ == module.__name__
    ]
    for function in own:
        assert {
            Path(each.py_func.__code__.co_filename) for each in _all_called(function, set())
        } <= (watched)
    named = re.findall(r"^from (automap\.[\w.]+) import", path.read_text(), re.MULTILINE)
    for name in named:
        place = ROOT.joinpath(*name.split("."))
        assert place.with_suffix(".py") in watched or place / "__init__.py" in watched


def test_the_earth_is_watched_where_it_is_compiled_in() -> None:
    assert PACKAGE / "earth.py" in sources_of(PACKAGE / "fusion" / "kernels" / "forward.py")


def test_nothing_is_compiled_but_by_the_one_decorator() -> None:
    others = [
        path
        for path in (*PACKAGE.rglob("*.py"), *(ROOT / "pipeline").rglob("*.py"))
        if re.search(
            r"numba import .*(jit|vectorize|cfunc)|numba\.(n?jit|vectorize)", path.read_text()
        )
    ]
    assert others == [PACKAGE / "jit.py"]


MAIN = """
import automap.mapping.caller as caller
print(caller.answer(1.0), caller.answer.stats.cache_hits[caller.answer.signatures[0]])
"""
CALLER = """
from automap.jit import kernel
from automap.mapping.helper import (
    SIZE,
    doubled,
)

@kernel
def answer(x):
    return doubled(x) + SIZE
"""
HELPER = """
from automap import depth
from automap.jit import kernel
SIZE = 10.0

@kernel
def doubled(x):
    return 2.0 * x + depth.DEPTH
"""


@pytest.mark.slow
@pytest.mark.parametrize("elsewhere", [pytest.param(False, marks=pytest.mark.slow), True])
def test_an_edit_of_a_helper_is_run(tmp_path: Path, elsewhere: bool) -> None:
    """Be it two modules away, of the same length and with the time that the file had before."""
    package = tmp_path / "automap"
    (package / "mapping").mkdir(parents=True)
    for name in ("__init__.py", "jit.py"):
        shutil.copy(PACKAGE / name, package / name)
    for name, text in (
        ("mapping/__init__", ""),
        ("mapping/caller", CALLER),
        ("mapping/helper", HELPER),
        ("depth", "DEPTH = 100.0\n"),
    ):
        (package / f"{name}.py").write_text(text)
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kept")} if elsewhere else {}
    variables = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    # python's own compiled files go by size and time
    variables |= kept | {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}

    def run() -> list[str]:
        command = [sys.executable, "-c", MAIN]
        done = subprocess.run(
            command, env=variables, capture_output=True, text=True, check=True, cwd=tmp_path
        )
        return done.stdout.split()

    def edit(name: str, old: str, new: str) -> None:
        path = package / name
        times = path.stat().st_atime_ns, path.stat().st_mtime_ns
        path.write_text(path.read_text().replace(old, new))
        os.utime(path, ns=times)

    assert run() == ["112.0", "0"]
    assert run() == ["112.0", "1"]
    edit("mapping/helper.py", "SIZE = 10.0", "SIZE = 20.0")
    assert run() == ["122.0", "0"]
    edit("mapping/helper.py", "2.0 * x", "3.0 * x")
    assert run() == ["123.0", "0"]
    edit("depth.py", "100.0", "200.0")
    assert run() == ["223.0", "0"]
    assert run() == ["223.0", "1"]


def test_no_kernel_lets_the_compiler_reorder_sums_or_leave_out_checks() -> None:
    # fastmath takes a check for NaN out, and orders sums anew with each compilation
    sources = [path for name in ("automap", "pipeline") for path in (ROOT / name).rglob("*.py")]
    told = [path.name for path in sources if "fastmath" in path.read_text(encoding="utf-8")]
    assert len(sources) > 100
    assert told == []


@pytest.mark.parametrize("damaged", ["*.nbi", "*.nbc"])
@pytest.mark.parametrize("left", [b"", b"cautomap.jit\nNothing\n."], ids=["empty", "of no class"])
def test_what_is_kept_and_cannot_be_read_is_compiled_again(
    tmp_path: Path, damaged: str, left: bytes
) -> None:
    source = tmp_path / "lone.py"
    source.write_text(
        "from automap.jit import kernel\n\n@kernel\ndef twice(x):\n    return 2 * x\n"
    )

    def hits() -> int:
        spec = importlib.util.spec_from_file_location("lone", source)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.twice(4) == 8
        return sum(module.twice.stats.cache_hits.values())

    assert hits() == 0
    assert hits() == 1
    (kept,) = tmp_path.rglob(damaged)
    version = kept.read_bytes()[: len(pickle.dumps(numba.__version__, protocol=-1))]
    kept.write_bytes((version if damaged == "*.nbi" else b"") + left)
    assert hits() == 0
    assert hits() == 1
