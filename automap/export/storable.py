"""Texts as files of other programs can hold them."""

from __future__ import annotations

from collections.abc import Sequence


def utf8_texts(values: Sequence[str | None]) -> Sequence[str | None]:
    """The texts with a question mark for each lone surrogate (from odd file names), which UTF-8
    cannot encode."""
    return values if _encodable(values) else [value and _utf8(value) for value in values]


def gdal_texts(values: Sequence[str | None]) -> Sequence[str | None]:
    """The same without NUL, at which GDAL ends a text."""
    values = utf8_texts(values)
    # at once: one by one is slow where a million are
    if "\0" not in "".join(filter(None, values)):
        return values
    return [value and value.replace("\0", "\ufffd") for value in values]


def _encodable(values: Sequence[str | None]) -> bool:
    """Whether all are, at once: one by one is slow where a million are."""
    try:
        "".join(filter(None, values)).encode()
    except UnicodeEncodeError:
        return False
    return True


def _utf8(text: str) -> str:
    return text.encode("utf-8", "replace").decode("utf-8")
