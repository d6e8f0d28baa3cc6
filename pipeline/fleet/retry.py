"""Drives that were put aside, on the list again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from automap.errors import InputError
from pipeline.fleet.store import ASIDE, Entry, Store


def retry(store: Store, wanted: Sequence[str]) -> list[Entry]:
    """Take the mark away from all, or from those with the paths, names or digests ``wanted``.

    Raises InputError for one that was not put aside.
    """
    there = store.entries()
    aside = [entry for entry in there if entry.aside and not entry.replaced and not entry.lost]
    chosen = [entry for entry in aside if not wanted or _named(entry) & _meant(wanted)]
    found = set().union(*(_named(entry) for entry in chosen)) if chosen else set()
    for text in wanted:
        if not _meant([text]) & found:
            raise InputError(f"{text}: no such drive was put aside; see automap fleet status.")
    for entry in chosen:
        store.unmark(entry.digest, ASIDE)
    return chosen


def _named(entry: Entry) -> set[str]:
    return {entry.digest, entry.path, entry.name}


def _meant(texts: Sequence[str]) -> set[str]:
    return {*texts, *(str(Path(text).resolve()) for text in texts)}
