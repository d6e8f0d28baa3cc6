"""What the site's pages get while it is built: the generated reference, the list of pages, and
equations as MathML, which browsers draw without a script."""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path
from typing import Any

import latex2mathml.converter
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))
import generated

_FIXED: list[tuple[str, list[str]]] = [
    ("Tutorial", ["tutorial.md"]),
    (
        "How to",
        [
            "howto/own-drive.md",
            "howto/review.md",
            "howto/authority.md",
            "howto/openstreetmap.md",
            "howto/calibrate.md",
            "howto/tune.md",
            "howto/own-detector.md",
            "howto/own-trajectory.md",
            "howto/batch.md",
            "howto/fleet.md",
            "howto/command-line.md",
        ],
    ),
    (
        "Reference",
        [
            "reference/commands.md",
            "reference/configuration.md",
            "reference/drive-folder.md",
            "reference/sign-fields.md",
            "reference/effects.md",
            "reference/exit-codes.md",
        ],
    ),
    (
        "Theory",
        ["theory/navigation.md", "theory/estimation.md", "theory/gnss.md", "theory/signs.md"],
    ),
    ("Inside", ["architecture.md", "contributing.md", "changelog.md"]),
]


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages."""
    for path, text in generated.pages().items():
        files.append(File.generated(config, path, content=text))
    return files


def on_config(config: Any) -> Any:
    """List the pages: the fixed ones, and every page that stands beside the start page."""
    folder = Path(config["docs_dir"])
    placed = {"index.md", *(page for _, pages in _FIXED for page in pages)}
    guides = sorted(p.name for p in folder.glob("*.md") if p.name not in placed)
    nav: list[Any] = [{"AutoMap": "index.md"}]
    for title, pages in _FIXED:
        nav.append({title: pages if len(pages) > 1 else pages[0]})
        if title == "How to":
            nav.append({"Guides": guides})
    config["nav"] = nav
    return config


def on_page_content(content: str, page: Any, config: Any, files: Files) -> str:
    """Equations in LaTeX become MathML."""
    inline = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
    block = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
    content = inline.sub(lambda m: _mathml(m[1], "inline"), content)
    return block.sub(lambda m: f'<div class="equation">{_mathml(m[1], "block")}</div>', content)


def _mathml(latex: str, display: str) -> str:
    return latex2mathml.converter.convert(html.unescape(latex).strip(), display=display)
