"""A small face for every class of sign, drawn by ourselves, and its name in words.

Classes of the vocabulary have their face; any other gets the shape and colour that its name
speaks of, with the number or the initials from it, so that no two classes look alike. A sign
of which only shape and colour are known has a question mark, which stands on no sign.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

ICON_PX = 64

_SHAPES = (
    # pattern, outline, fill, border (BGR), ink
    (r"stop", "octagon", (28, 18, 193), (245, 245, 245), (245, 245, 245)),
    (r"yield|give-?way", "triangle-down", (245, 245, 245), (28, 18, 193), (25, 25, 25)),
    (r"no-entry|do-not-enter", "circle", (28, 18, 193), (245, 245, 245), (245, 245, 245)),
    (r"yellow-diamond", "diamond", (0, 209, 255), (25, 25, 25), (25, 25, 25)),
    (r"blue-circle|mandatory|keep-|turn-|straight", "circle", (161, 92, 3), (245, 245, 245),
     (245, 245, 245)),
    (r"blue-square|information|parking|service|guide", "square", (161, 92, 3), (245, 245, 245),
     (245, 245, 245)),
    (r"triangle|warning|danger", "triangle-up", (245, 245, 245), (28, 18, 193), (25, 25, 25)),
    (r"priority", "diamond", (0, 209, 255), (245, 245, 245), (25, 25, 25)),
    (r"speed|limit|regulatory|prohibit|circle|no-", "circle", (245, 245, 245), (28, 18, 193),
     (25, 25, 25)),
    (r"", "square", (245, 245, 245), (90, 90, 90), (25, 25, 25)),
)  # fmt: skip

_FILLS = {
    # the first word of a group: fill, border (BGR), ink; the red is that of the rim
    "red": ((245, 245, 245), (28, 18, 193), (25, 25, 25)),
    "blue": ((161, 92, 3), (245, 245, 245), (245, 245, 245)),
    "yellow": ((0, 209, 255), (25, 25, 25), (25, 25, 25)),
    "orange": ((0, 130, 245), (25, 25, 25), (25, 25, 25)),
    "green": ((70, 120, 0), (245, 245, 245), (245, 245, 245)),
    "white": ((245, 245, 245), (25, 25, 25), (25, 25, 25)),
    "black": ((25, 25, 25), (245, 245, 245), (245, 245, 245)),
    "other": ((245, 245, 245), (90, 90, 90), (25, 25, 25)),
}

Face = tuple[str, tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]
"""Outline, colours of fill and border (BGR), ink."""


def sign_words(class_name: str) -> str:
    """A class name as people say it: ``regulatory--stop--g1`` is "stop"."""
    parts = [part for part in class_name.split("--") if not re.fullmatch(r"g\d+", part)]
    return " ".join(parts[1:] if len(parts) > 1 else parts).replace("-", " ")


def words_apart(class_names: Iterable[str]) -> dict[str, str]:
    """The words of several classes, with what tells apart those that share them: the kind (a
    roundabout is warned of, and ordered), the number of the version."""
    said = {name: sign_words(name) for name in class_names}
    kind = {name: name.partition("--")[0] for name in said}
    alike = Counter(said.values())
    same_kind = Counter((words, kind[name]) for name, words in said.items())
    apart = {}
    for name, words in said.items():
        own = same_kind[words, kind[name]]
        told = [kind[name]] if own < alike[words] else []
        told += [name.rpartition("--")[2]] if own > 1 else []
        apart[name] = f"{words} ({', '.join(told)})" if told and "--" in name else words
    return apart


@cache
def class_icon(class_name: str, px: int = ICON_PX) -> bytes:
    """The face of a class as PNG with transparency [px, px]."""
    import cv2

    from automap.signs.faces import draw_face

    # another country's version of a face that is drawn says the same
    own = _drawn_class(class_name)
    image = draw_face(own, px) if own else _drawn(class_name, px)
    good, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not good:
        raise RuntimeError(f"the face of {class_name!r} could not be written as PNG")
    return bytes(data.tobytes())


def _drawn_class(class_name: str) -> str | None:
    """The class of the vocabulary that is this one, else one of the same face; None without."""
    from automap.signs.codes import face_of
    from automap.signs.vocabulary import load_vocabulary

    classes = load_vocabulary().classes
    if class_name in classes:
        return class_name
    face = face_of(class_name)
    return next((name for name in classes if face_of(name) == face), None)


def icon_text(class_name: str) -> str:
    """The number in a class name, else the initials of its words, at most three characters;
    "?" where the class is not known."""
    words = re.findall(r"[a-z]+|\d+", sign_words(class_name).lower())
    if "unknown" in words:
        return "?"
    numbers = [word for word in words if word.isdigit()]
    if numbers:
        return str(numbers[-1])[:3]
    return "".join(str(word)[0] for word in words)[:3].upper()


def _face_of(name: str) -> Face:
    """The look of a class: of its group where the table has it, else what its name speaks of."""
    from automap.signs.national import class_entry
    from automap.signs.vocabulary import load_vocabulary

    entry = class_entry(name)
    group = entry.group if entry else load_vocabulary().group_of(name)
    if group is None:
        _, shape, fill, border, ink = next(row for row in _SHAPES if re.search(row[0], name))
        return shape, fill, border, ink
    colour, _, outline = group.partition("-")
    return (outline or "square", *_FILLS.get(colour, _FILLS["other"]))


def _drawn(class_name: str, px: int) -> Any:
    import cv2

    from automap.signs.outlines import outline_points

    name = class_name.lower()
    shape, fill, border, ink = _face_of(name)
    n = 4 * px
    corners = outline_points(shape)
    centre = corners.mean(axis=0)
    canvas = np.zeros((n, n, 4), np.uint8)
    rim = fill if border == (245, 245, 245) else border
    for share, colour in ((0.98, rim), (0.92, border), (0.76, fill)):
        points = np.rint(((corners - centre) * share + centre) * (n - 1)).astype(np.int32)
        cv2.fillPoly(canvas, [points], (*colour, 255), cv2.LINE_AA)
    text = icon_text(class_name)
    if "two-way" in name:
        reach = 0.14 if shape.startswith("triangle") else 0.2
        for x, (tail, tip) in (
            (0.41, (0.5 - reach, 0.5 + reach)),
            (0.59, (0.5 + reach, 0.5 - reach)),
        ):
            start, end = (
                (int((x + centre[0] - 0.5) * n), int((y + centre[1] - 0.5) * n))
                for y in (tail, tip)
            )
            width = n // 20
            cv2.arrowedLine(canvas, start, end, (*ink, 255), width, cv2.LINE_AA, tipLength=0.35)
    elif text:
        font, thickness = cv2.FONT_HERSHEY_SIMPLEX, max(1, n // 28)
        (width, height), _ = cv2.getTextSize(text, font, 1.0, thickness)
        room, tall = (0.34, 0.36) if shape.startswith("triangle") else (0.5, 0.48)
        scale = n * min(room / max(width, 1), tall / max(height, 1))
        at = centre * n + np.array([-0.5 * width, 0.5 * height]) * scale
        place = (int(at[0]), int(at[1]))
        cv2.putText(canvas, text, place, font, scale, (*ink, 255), thickness, cv2.LINE_AA)
    return cv2.resize(canvas, (px, px), interpolation=cv2.INTER_AREA)
