"""Texts of a recording in CSV files that people open with a spreadsheet."""

from __future__ import annotations

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "'")


def csv_cell(text: str, back: bool = False) -> str:
    """A text that a spreadsheet takes for text: one that would be a formula gets an apostrophe.

    With ``back`` the text that such a cell stands for.
    """
    if back:
        return text[1:] if text.startswith("'") else text
    return f"'{text}" if text.startswith(_FORMULA) else text
