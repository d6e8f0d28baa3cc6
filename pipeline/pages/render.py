"""Putting a page together: everything it needs stands in the one file, which asks for nothing.

All text of a recording is escaped by the template engine, or passed as JSON and set as text by
the page's script; the page's security policy forbids every request.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from automap import __version__
from pipeline.pages.palette import colours_css
from pipeline.pages.section import Figure, Section

if TYPE_CHECKING:
    from jinja2 import Environment


def render(template: str, *, leaflet: bool = False, **content: Any) -> str:
    """The page that a template of ``pages/templates`` makes of ``content``.

    Every template extends ``base.html.j2``; with ``leaflet`` the page has what maps need.
    """
    from markupsafe import Markup

    style = (_leaflet_style() if leaflet else "") + colours_css() + asset("page.css")
    page = (
        _environment()
        .get_template(template)
        .render(
            version=__version__,
            style=Markup(style),
            leaflet=Markup(_leaflet_script()) if leaflet else "",
            **content,
        )
    )
    # a folder's name that is no UTF-8 cannot be written as it is
    return page.encode("utf-8", "replace").decode("utf-8")


@cache
def _environment() -> Environment:
    """The template engine; one, so that a template is compiled once."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FunctionLoader(asset),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["embedded"] = lambda value: Markup(embedded_json(value))
    environment.globals["asset"] = lambda name: Markup(asset(name))
    return environment


def sections_page(
    title: str,
    name: str,
    figures: Sequence[Figure],
    parts: Sequence[tuple[str, Section]],
    warnings: Sequence[str] = (),
    facts: Sequence[tuple[str, str]] = (),
    **drawn: Any,
) -> str:
    """A page of key figures, sections under their headings, and the conditions they hold for;
    ``drawn`` a ``map`` and ``sign_table`` as the report of a run has them, above the sections."""
    return render(
        "sections.html.j2",
        leaflet=drawn.get("map") is not None,
        **drawn,
        title=title,
        name=name,
        figures=figures,
        parts=parts,
        warnings=warnings,
        facts=[*facts] or [("version", __version__)],
    )


def asset(name: str) -> str:
    """The text of a file beside the templates."""
    folder = resources.files("pipeline") / "pages" / "templates"
    return (folder / name).read_text(encoding="utf-8")


def embedded_json(value: Any) -> str:
    """JSON that can stand inside a script element whatever text it holds."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _leaflet_script() -> str:
    # the map of its source would be another file
    return re.sub(r"\n//# sourceMappingURL=.*", "", asset("leaflet/leaflet.js"))


def _leaflet_style() -> str:
    # pictures of controls that the page does not have
    style = re.sub(r"url\([^)]*\)", "none", asset("leaflet/leaflet.css"))
    return re.sub(r"/\*.*?\*/", "", style, flags=re.DOTALL)
