"""Digits and a few capitals as strokes, for drawing sign faces."""

from __future__ import annotations

import math

Point = tuple[float, float]


def _arc(cx: float, cy: float, rx: float, ry: float, begin: float, end: float) -> list[Point]:
    """Points of an elliptic arc, angles in degrees clockwise from right (y down)."""
    n = max(2, int(abs(end - begin) / 8))
    angles = [math.radians(begin + (end - begin) * i / n) for i in range(n + 1)]
    return [(cx + rx * math.cos(a), cy + ry * math.sin(a)) for a in angles]


# strokes run through a box of height 1 and the given width, y down; widths follow the
# proportions of road lettering (DIN 1451, FHWA series D), where all digits are equally wide
_W = 0.56
_R = _W / 2
GLYPHS: dict[str, tuple[float, list[list[Point]]]] = {
    "0": (
        _W,
        [
            _arc(_R, 0.30, _R, 0.30, 180, 360) + _arc(_R, 0.70, _R, 0.30, 0, 180) + [(0, 0.30)],
        ],
    ),
    "1": (0.34, [[(0.0, 0.22), (0.26, 0.0), (0.26, 1.0)]]),
    "2": (_W, [[*_arc(_R, 0.28, _R, 0.28, 190, 390), (0.0, 1.0), (_W, 1.0)]]),
    "3": (
        _W,
        [_arc(_R, 0.26, 0.24, 0.26, 200, 450), _arc(_R, 0.74, _R, 0.26, -90, 160)],
    ),
    "4": (0.6, [[(0.44, 1.0), (0.44, 0.0), (0.0, 0.70), (0.60, 0.70)]]),
    "5": (
        _W,
        [[(0.52, 0.0), (0.06, 0.0), (0.03, 0.44), *_arc(_R, 0.67, _R, 0.33, 225, 515)]],
    ),
    "6": (
        _W,
        [_arc(_R, 0.70, _R, 0.30, 0, 360), [(0.0, 0.70), (0.02, 0.42), (0.14, 0.14), (0.40, 0.0)]],
    ),
    "7": (_W, [[(0.0, 0.0), (_W, 0.0), (0.18, 1.0)]]),
    "8": (
        _W,
        [_arc(_R, 0.25, 0.24, 0.25, 0, 360), _arc(_R, 0.74, _R, 0.26, 0, 360)],
    ),
    "9": (
        _W,
        [_arc(_R, 0.30, _R, 0.30, 0, 360), [(_W, 0.30), (0.54, 0.58), (0.42, 0.86), (0.16, 1.0)]],
    ),
    "S": (
        0.54,
        [_arc(0.27, 0.25, 0.27, 0.25, -25, -270) + _arc(0.27, 0.75, 0.27, 0.25, -90, 155)],
    ),
    "T": (0.54, [[(0.0, 0.0), (0.54, 0.0)], [(0.27, 0.0), (0.27, 1.0)]]),
    "O": (
        _W,
        [
            _arc(_R, 0.30, _R, 0.30, 180, 360) + _arc(_R, 0.70, _R, 0.30, 0, 180) + [(0, 0.30)],
        ],
    ),
    "P": (
        0.54,
        [
            [
                (0.0, 1.0),
                (0.0, 0.0),
                (0.27, 0.0),
                *_arc(0.27, 0.27, 0.27, 0.27, -90, 90),
                (0.0, 0.54),
            ],
        ],
    ),
    "H": (0.56, [[(0.0, 0.0), (0.0, 1.0)], [(0.56, 0.0), (0.56, 1.0)], [(0.0, 0.5), (0.56, 0.5)]]),
}

STROKE = 0.17
"""Width of a stroke relative to the height of the letters' middle lines."""

SPACING = 0.34
"""From the middle line of one letter to that of the next, relative to the height."""


def text_strokes(text: str, centre: Point, height: float) -> tuple[list[list[Point]], float]:
    """Polylines of a text and their width, ``height`` over all, centred at ``centre``.

    Raises KeyError for a character that has no glyph.
    """
    scale = height / (1.0 + STROKE)
    width = sum(GLYPHS[c][0] for c in text) + SPACING * (len(text) - 1)
    x = centre[0] - scale * width / 2.0
    top = centre[1] - scale / 2.0
    lines = []
    for character in text:
        advance, strokes = GLYPHS[character]
        lines += [[(x + scale * px, top + scale * py) for px, py in line] for line in strokes]
        x += scale * (advance + SPACING)
    return lines, scale * STROKE
