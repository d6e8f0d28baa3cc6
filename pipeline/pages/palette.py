"""The colours of all pages and figures.

``ON_LIGHT`` and ``ON_DARK`` tell series and classes apart: those of Okabe and Ito (Color Universal
Design, 2008), darkened where a thin line would not show on white, lightened for the dark.
"""

from __future__ import annotations

from automap.export.kml_track import SIGMA_COLOURS, UNKNOWN_COLOUR

ON_LIGHT = (
    *("#0072b2", "#d55e00", "#009e73", "#b15a94"),
    *("#b98400", "#3b8fc2", "#6a3d9a", "#666666"),
)
ON_DARK = (
    *("#56b4e9", "#f08a3c", "#2fc89a", "#e39ac6"),
    *("#e6b93d", "#8cc8f0", "#b392e0", "#aaaaaa"),
)

_LIGHT = {
    **{"paper": "#f6f7f9", "card": "#ffffff", "ink": "#1c2128", "soft": "#59636e"},
    **{"line": "#d9dee4", "grid": "#e6eaee", "map": "#eef1f4", "map-grid": "#d7dde3"},
    **{"accent": "#0b6bcb", "good": "#1a7f37", "bad": "#cf222e", "warn": "#9a6700"},
    **{"warn-bg": "#fff6e0", "warn-line": "#e3b341", "warn-ink": "#6b4b00"},
}
_DARK = {
    **{"paper": "#0f1318", "card": "#171c23", "ink": "#e4e9ee", "soft": "#9aa5b1"},
    **{"line": "#2c343d", "grid": "#262e37", "map": "#12171d", "map-grid": "#252d36"},
    **{"accent": "#58a6ff", "good": "#3fb950", "bad": "#ff6b63", "warn": "#e3b341"},
    **{"warn-bg": "#2b230d", "warn-line": "#9e7a1c", "warn-ink": "#f0d58c"},
}
_PRINT = {
    **{"paper": "#fff", "card": "#fff", "ink": "#000", "soft": "#444", "line": "#ccc"},
    **{"grid": "#e2e2e2", "map": "#fff", "map-grid": "#e2e2e2", "accent": "#0b6bcb"},
    **{"warn-bg": "#fff", "warn-ink": "#000"},
}


def colours_css() -> str:
    """The colours as variables of a style sheet, for light, dark and paper.

    ``--c0`` ... tell things apart and are classes too, ``--s0`` ... go from sure to unsure, with
    ``--unknown`` beside them.
    """
    sure = {f"s{k}": colour for k, colour in enumerate(SIGMA_COLOURS)}
    light, dark = _numbered(ON_LIGHT), _numbered(ON_DARK)
    classes = "".join(f".{name} {{ color: var(--{name}); }}\n" for name in light)
    return (
        ":root { color-scheme: light dark; "
        f"{_variables(_LIGHT | light | sure | {'unknown': UNKNOWN_COLOUR})} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {_variables(_DARK | dark)} }} }}\n"
        f"@media print {{ :root {{ {_variables(_PRINT | light)} }} }}\n{classes}"
    )


def _numbered(colours: tuple[str, ...]) -> dict[str, str]:
    return {f"c{number}": colour for number, colour in enumerate(colours)}


def _variables(colours: dict[str, str]) -> str:
    return " ".join(f"--{name}: {colour};" for name, colour in colours.items())
