"""The pages for who changes the code name files, functions and layers that exist."""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from tests.docs_commands import DOCS, ROOT
from tests.unit.test_layers import APPLICATION, LAYERS

ARCHITECTURE = DOCS / "architecture.md"
PAGES = (ARCHITECTURE, ROOT / "CONTRIBUTING.md")
_SPAN = re.compile(r"`([^`\n]+)`")
_FILE = re.compile(r"(automap|pipeline|tests|docs|configs|\.ci)/[\w./-]+")
_NAME = re.compile(r"(\w+)\(\)|[A-Z][A-Za-z]+[a-z]\w*|(?!AUTOMAP_|APPLICATION)[A-Z][A-Z_]{3,}")


def spans(page: Path) -> Iterator[tuple[int, str]]:
    """Line and text of every piece of code within the sentences and tables of a page."""
    fenced = False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        fenced ^= line.startswith("```")
        if not fenced:
            yield from ((number, span) for span in _SPAN.findall(line))


def missing(page: Path) -> list[str]:
    """Files that do not exist, functions that neither the Python file named before nor the one
    named after has, and other names that no file named on the page has."""
    wrong = []
    found = list(spans(page))
    files: list[tuple[int, ModuleType]] = []
    for place, (line, span) in enumerate(found):
        if not _FILE.fullmatch(span):
            continue
        if not (ROOT / span).exists():
            wrong.append(f"{page.name}:{line}: there is no {span}")
        elif span.endswith(".py") and not span.startswith("tests/"):
            name = span.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
            files.append((place, importlib.import_module(name)))
    for place, (line, span) in enumerate(found):
        if (named := _NAME.fullmatch(span)) is None:
            continue
        before = [module for at, module in files if at < place][-1:]
        after = [module for at, module in files if at > place][:1]
        near = before + after if named[1] else [module for _, module in files]
        name = named[1] or span
        if not any(hasattr(module, name) for module in near):
            wrong.append(f"{page.name}:{line}: there is no {name} in {[m.__name__ for m in near]}")
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_and_function_exists(page: Path) -> None:
    assert missing(page) == []


def test_a_wrong_name_would_be_noticed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "`automap/earth.py` has `gravity_of_the_moon()` and `Moon`; see `automap/moon.py`.\n",
        encoding="utf-8",
    )
    assert len(missing(page)) == 3


def test_the_page_shows_the_layers_that_hold() -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8").split("## The layers")[1].split("\n## ")[0]
    table = re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)
    assert table == [*LAYERS, "pipeline"]
    library, application = re.findall(r"^```text\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert drawn(library) == [*LAYERS, "pipeline"]
    assert drawn(application) == [*APPLICATION]


def drawn(picture: str) -> list[str]:
    """The names of a picture of layers from the ground up."""
    layers = [re.split(r"\s{3,}", line)[0].split() for line in reversed(picture.splitlines())]
    return [name for layer in layers for name in layer]


def test_what_is_said_to_have_moved_is_there_and_not_where_it_was() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1]
    moved = re.findall(r"^\| `([\w.]+)` \| `([\w.]+)`", text, re.MULTILINE)
    assert len(moved) > 5
    for before, now in moved:
        assert importlib.util.find_spec(now) is not None, now
        path = ROOT / before.replace(".", "/")
        assert not path.with_suffix(".py").exists(), before
        assert not (path / "__init__.py").exists(), before


def test_each_way_is_in_the_order_of_its_numbers() -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8")
    for way in text.split("\n## The way of one ")[1:]:
        numbers = [int(n) for n in re.findall(r"^\| (\d+) \|", way, re.MULTILINE)]
        assert numbers == list(range(1, len(numbers) + 1))
        assert len(numbers) > 10
