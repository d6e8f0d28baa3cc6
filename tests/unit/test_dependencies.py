"""What is imported is declared, what is declared is pinned, and the layers stay apart."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest

from release.pins import read_pins
from tests.sources import imports_of

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# modules of the tests are also imported from beside the test that uses them
# named by a package's wheel for building its own documentation
NEVER_IMPORTED = {"allantools": {"numpydoc"}}
# pytest itself loads its plugin
LOADED_BY = {"pipeline/pytest_plugin.py": "pytest"}
OWN = {"automap", "pipeline", "release", "tests"}
OWN |= {path.stem for path in (ROOT / "tests").rglob("*.py")}


def imported(folder: str) -> Iterator[tuple[Path, str]]:
    """The top-level names that the sources below a folder import, with the file."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        for _, module, _ in imports_of(path):
            yield path.relative_to(ROOT), module.split(".")[0]


def normal(name: str) -> str:
    """A package name as the index compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def required(requirements: list[str]) -> set[str]:
    """Names in a list of requirements."""
    return {normal(re.split(r"[<>=!~;\[ ]", text, maxsplit=1)[0]) for text in requirements}


def locked(name: str) -> dict[str, str]:
    """Names and versions in a lock file."""
    return {pin.name: pin.version for pin in read_pins(ROOT / name)}


@cache
def distributions() -> Mapping[str, list[str]]:
    """Which distributions bring each module; all that is installed is gone through for it."""
    return metadata.packages_distributions()


RUNTIME = required(PROJECT["dependencies"])
DEV = required(PROJECT["optional-dependencies"]["dev"])
# what trains the networks is never imported by what uses them
TRAINING = required(PROJECT["optional-dependencies"]["training"])
# nor is what runs very many drives
FLEET = required(PROJECT["optional-dependencies"]["fleet"])
EXTRAS = {Path("pipeline/train"): TRAINING, Path("pipeline/fleet"): FLEET | {"dask"}}


@pytest.mark.parametrize(
    ("folder", "allowed"), [("automap", RUNTIME), ("pipeline", RUNTIME), ("tests", RUNTIME | DEV)]
)
def test_every_import_is_declared(folder: str, allowed: set[str]) -> None:
    missing = []
    for path, module in imported(folder):
        if module in sys.stdlib_module_names or module in OWN:
            continue
        if LOADED_BY.get(path.as_posix()) == module:
            continue
        owners = {normal(name) for name in distributions().get(module, [module.replace("_", "-")])}
        extra: set[str] = set().union(*(EXTRAS.get(folder, set()) for folder in path.parents))
        if not owners & (allowed | extra):
            missing.append(f"{path}: {module}")
    assert missing == []


def test_what_is_declared_is_pinned() -> None:
    runtime, dev = locked("requirements.lock"), locked("requirements-dev.lock")
    assert RUNTIME - runtime.keys() == set()
    assert DEV - dev.keys() - runtime.keys() == set()
    assert runtime.keys() & dev.keys() == set()


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-dev.lock"])
def test_the_pins_are_complete(name: str) -> None:
    everything = locked("requirements.lock") | locked(name)
    for package in locked(name):
        try:
            needs = metadata.requires(package) or []
        except metadata.PackageNotFoundError:
            pytest.skip(f"{package} is not installed")
        # extras and other systems' needs carry a marker; these are not pinned
        plain = [text for text in needs if ";" not in text]
        missing = required(plain) - everything.keys() - NEVER_IMPORTED.get(package, set())
        assert missing == set(), package
