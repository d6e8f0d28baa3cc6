"""The colours of plots, on pages and in figures: those of Okabe and Ito (Color Universal Design,
2008) darkened where they would not show as thin lines on white, lightened for the dark."""

from __future__ import annotations

ON_LIGHT = (
    *("#0072b2", "#d55e00", "#009e73", "#b15a94"),
    *("#b98400", "#3b8fc2", "#6a3d9a", "#666666"),
)
ON_DARK = (
    *("#56b4e9", "#f08a3c", "#2fc89a", "#e39ac6"),
    *("#e6b93d", "#8cc8f0", "#b392e0", "#aaaaaa"),
)


def colours_css() -> str:
    """Variables --c0 ... and classes c0 ... for light, dark and paper."""
    light, dark = (
        " ".join(f"--c{number}: {colour};" for number, colour in enumerate(colours))
        for colours in (ON_LIGHT, ON_DARK)
    )
    classes = "".join(f".c{number} {{ color: var(--c{number}); }}\n" for number in range(8))
    return (
        f":root {{ {light} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
        f"@media print {{ :root {{ {light} }} }}\n{classes}"
    )
