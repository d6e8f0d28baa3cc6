"""The commands that stand in the documentation.

Those in blocks of ``sh`` are run by a slow test; those in other blocks (``bash``, ``text``) name
files or devices that only a user has, and are parsed.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


@dataclass(frozen=True)
class Command:
    """One command line: ``runnable`` for an automap command in a block of sh; a test runs it."""

    page: str
    line: str
    runnable: bool

    @property
    def words(self) -> list[str]:
        """The words up to a pipe or a redirection."""
        words = shlex.split(self.line)
        ends = [
            k for k, word in enumerate(words) if word in ("|", "||", ">", ">>", "&&", "&", "2>&1")
        ]
        return words[: ends[0]] if ends else words


def pages() -> list[Path]:
    """Every page that is written by hand."""
    return sorted(p for p in DOCS.rglob("*.md") if "site" not in p.relative_to(DOCS).parts)


def commands(page: Path) -> list[Command]:
    """The command lines of a page's code blocks, in their order; continued lines are joined."""
    found = []
    text = page.read_text(encoding="utf-8")
    for language, block in re.findall(
        r"^```(\w*)[^\n]*\n(.*?)^```", text, re.MULTILINE | re.DOTALL
    ):
        for line in block.replace("\\\n", " ").splitlines():
            line = line.strip().removeprefix("$ ")
            own = line.startswith("automap ")
            if own or (language == "sh" and line and not line.startswith("#")):
                found.append(Command(str(page.relative_to(DOCS)), line, own and language == "sh"))
    return found


def scripts(page: Path) -> list[str]:
    """The Python blocks without a title, which rest on what the commands before them left."""
    text = page.read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def files(page: Path) -> dict[str, str]:
    """The files that a page shows whole: code blocks with a title, name -> content."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r'^```\w+ title="([\w.]+)"\n(.*?)^```', text, re.MULTILINE | re.DOTALL)
    return dict(blocks)
