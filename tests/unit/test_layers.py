"""The layers of the code: arrows point downwards, nothing goes round in a circle, and what
estimates touches no file.

Every import counts, wherever it stands: at the top, inside a function, for the type checker.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from tests.sources import imports_of

ROOT = Path(__file__).resolve().parents[2]

LAYERS = (
    # what everybody speaks of: plain data, pure functions
    *("errors", "records", "earth", "geoid", "frames", "timebase", "interpolation", "lever_arm"),
    *("jit", "columns_between", "gates", "assignment", "robust", "sparse_normal"),
    # what signs look like, what sensors do wrong
    *("signs", "effects"),
    # formats: bytes to records and back
    "io",
    # estimators: records in, records out
    *("sync", "fusion", "calibration", "vision", "mapping", "geolocation"),
    # what people make of a map
    *("review", "roads", "inventory"),
    # what uses them
    *("simulation", "evaluation", "regression", "gap"),
    # records to files of other people's formats
    "export",
)
"""Packages and modules of ``automap`` from the ground up: each imports what stands before it."""

APPLICATION = (
    # what several commands use
    *("shared", "settings", "pages"),
    # commands that do one thing, as stages of a run or on their own
    *("check", "detect", "export", "report", "evaluate", "calibrate", "simulate", "importers"),
    *("init", "record", "merge", "compare", "view", "train"),
    # what runs drives, and commands that have them run
    *("run", "experiments", "gap", "regress", "fleet"),
    # what starts them
    *("cli", "pytest_plugin"),
)
"""Packages of ``pipeline`` likewise."""

TOUCH_FILES = ("io", "export")
"""The packages that open files; of the library only the second may import the first."""

OPENS_FILES = {
    "automap.jit": "the kernels' compiled code beside the sources is thrown away when it is stale",
    "automap.vision.onnx_model": "onnxruntime opens a network by its path",
    "automap.vision.custom": "onnxruntime opens a network by its path",
}
"""Modules elsewhere that touch a file all the same, and why."""


@dataclass(frozen=True)
class Import:
    """``source`` imports ``target``, both modules, in ``line`` of ``path``."""

    source: str
    target: str
    path: Path
    line: int

    def __str__(self) -> str:
        where = self.path.relative_to(ROOT) if self.path.is_relative_to(ROOT) else self.path
        return f"{where}:{self.line}: {self.source} -> {self.target}"


def modules(root: Path) -> dict[str, Path]:
    """The files of ``automap`` and ``pipeline`` by the names of their modules."""
    found = {}
    for top in ("automap", "pipeline"):
        for path in sorted((root / top).rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


@cache
def imports(root: Path) -> list[Import]:
    """All imports between our own modules; ``from package import module`` is one of the module."""
    files = modules(root)
    found = []
    for source, path in files.items():
        for line, module, name in imports_of(path):
            target = f"{module}.{name}" if name else module
            while target and target not in files:
                target = target.rpartition(".")[0]
            if target and target != source:
                found.append(Import(source, target, path, line))
    return found


def package(module: str) -> str:
    """``automap.io`` of ``automap.io.ubx``."""
    return ".".join(module.split(".")[:2])


def upward(arrows: Iterable[Import]) -> list[Import]:
    """Imports of the library that point upwards, or from below to the formats."""
    rank = {"automap": -1} | {f"automap.{name}": place for place, name in enumerate(LAYERS)}
    formats = f"automap.{TOUCH_FILES[0]}"
    may_read = {f"automap.{name}" for name in TOUCH_FILES}
    wrong = []
    for arrow in arrows:
        source, target = package(arrow.source), package(arrow.target)
        if source == target or not source.startswith("automap"):
            continue
        assert source in rank, f"{arrow}: give {source} its place in LAYERS"
        if rank.get(target, len(LAYERS)) > rank[source] or (
            target == formats and source not in may_read
        ):
            wrong.append(arrow)
    return wrong


def circles(arrows: Iterable[tuple[str, str]]) -> list[list[str]]:
    """The sets of two names or more that lead to each other (Tarjan's strong components)."""
    graph: dict[str, set[str]] = {}
    for source, target in arrows:
        graph.setdefault(source, set()).add(target)
        graph.setdefault(target, set())
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        number[name] = low[name] = len(number)
        stack.append(name)
        for other in sorted(graph[name]):
            if other not in number:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == number[name]:
            at = stack.index(name)
            if len(stack) - at > 1:
                found.append(sorted(stack[at:]))
            del stack[at:]

    for name in sorted(graph):
        if name not in number:
            visit(name)
    return found


_FILE_CALLS = frozenset(
    (
        *("open", "read_text", "write_text", "read_bytes", "write_bytes", "mkdir", "touch"),
        *("unlink", "iterdir", "glob", "rglob", "symlink_to", "ZipFile", "NamedTemporaryFile"),
        *("TemporaryDirectory", "mkdtemp", "run_path", "urlopen", "loadtxt", "genfromtxt"),
        *("fromfile", "memmap", "savez", "savez_compressed", "tofile", "read_csv", "read_parquet"),
        *("read_table", "read_json", "read_excel", "write_table", "to_csv", "to_parquet"),
        *("imread", "imwrite", "VideoCapture", "VideoWriter", "InferenceSession"),
    )
)
"""Names of functions and methods that open, make or remove files, whosever they are,"""
_FILE_CALLS_OF = {
    **dict.fromkeys(("np", "numpy"), ("load", "save")),
    **dict.fromkeys(("json", "pickle", "tomllib"), ("load", "dump")),
    "os": ("remove", "rename", "replace", "makedirs", "listdir", "scandir", "fdopen"),
    "shutil": ("copy", "copyfile", "copytree", "move", "rmtree"),
}
"""and those of certain modules."""


def file_calls(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of each call that touches a file, but for a package's own data."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Name) and called.id in _FILE_CALLS:
            yield node.lineno, called.id
        elif isinstance(called, ast.Attribute):
            of = called.value.id if isinstance(called.value, ast.Name) else ""
            listed = called.attr in _FILE_CALLS or called.attr in _FILE_CALLS_OF.get(of, ())
            if listed and not _is_own_data(called.value):
                yield node.lineno, f"{of}.{called.attr}" if of else called.attr


def _is_own_data(node: ast.AST) -> bool:
    """``files("automap.signs").joinpath(...)``: what is installed with the code."""
    return any(
        isinstance(part, ast.Call) and isinstance(part.func, ast.Name) and part.func.id == "files"
        for part in ast.walk(node)
    )


@cache
def files_touched(root: Path) -> dict[str, list[str]]:
    """Modules of the library, outside of the formats and the exports, that touch files, and the
    places where they do."""
    allowed = {f"automap.{name}" for name in TOUCH_FILES}
    touched = {
        name: [
            f"{path.relative_to(root)}:{line}: {name} calls {call}"
            for line, call in file_calls(ast.parse(path.read_bytes()))
        ]
        for name, path in modules(root).items()
        if name.startswith("automap.") and package(name) not in allowed
    }
    return {name: places for name, places in touched.items() if places}


def told(arrows: Iterable[object], what: str) -> str:
    return f"{what}:\n" + "\n".join(f"  {arrow}" for arrow in arrows)


def test_arrows_point_downwards() -> None:
    wrong = upward(imports(ROOT))
    assert not wrong, told(wrong, "imports that point upwards, or from below to the formats")


def test_the_library_does_not_know_the_application() -> None:
    arrows = imports(ROOT)
    assert {package(a.source) for a in arrows if a.source.startswith("automap.")} <= {
        f"automap.{name}" for name in LAYERS
    }
    assert not [a for a in arrows if a.source.startswith("automap") and "pipeline" in a.target]


def test_commands_stand_on_what_they_share_and_the_command_line_on_commands() -> None:
    rank = {f"pipeline.{name}": place for place, name in enumerate(APPLICATION)}
    arrows = [a for a in imports(ROOT) if a.target.startswith("pipeline.")]
    assert {package(a.source) for a in arrows} <= set(rank), "give them their place in APPLICATION"
    wrong = [a for a in arrows if rank[package(a.target)] > rank[package(a.source)]]
    assert not wrong, told(wrong, "imports that point upwards in the application")


@pytest.mark.parametrize("of", [package, str], ids=["packages", "modules"])
def test_nothing_goes_round_in_a_circle(of: Callable[[str], str]) -> None:
    arrows = [a for a in imports(ROOT) if of(a.source) != of(a.target)]
    wrong = []
    for circle in circles((of(a.source), of(a.target)) for a in arrows):
        wrong += [f"{', '.join(circle)} import each other:"]
        wrong += [str(a) for a in arrows if of(a.source) in circle and of(a.target) in circle]
    assert not wrong, told(wrong, "circles")


def test_only_formats_and_exports_touch_files() -> None:
    touched = files_touched(ROOT)
    wrong = [place for name in touched.keys() - OPENS_FILES for place in touched[name]]
    assert not wrong, told(wrong, "files are touched outside of automap.io and automap.export")


def test_every_excuse_is_needed() -> None:
    assert OPENS_FILES.keys() <= files_touched(ROOT).keys()
