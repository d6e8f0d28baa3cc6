"""What the views of a sign give to each class, as text for tables: ``NAME SHARE; NAME SHARE``."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping


def commonest(names: Iterable[str]) -> str:
    """The name that most views have; the alphabet decides between equals."""
    return min(Counter(names).items(), key=lambda item: (-item[1], item[0]))[0]


def shares_text(shares: Iterable[tuple[str, float]]) -> str:
    """Names with their shares, in the order given."""
    return "; ".join(f"{name} {share:.3f}" for name, share in shares)


def shares_of(text: str) -> dict[str, float]:
    """The shares by name; what is no name with a share within 0 and 1 is left out."""
    shares = {}
    for part in text.split(";"):
        name, _, told = part.strip().rpartition(" ")
        try:
            share = float(told)
        except ValueError:
            continue
        if name and math.isfinite(share) and 0.0 <= share <= 1.0:
            shares[name] = share
    return shares


def mean_of(texts: Iterable[str] | Mapping[str, int]) -> dict[str, float]:
    """The mean of the shares of those that tell any, each alike, or as often as it is counted;
    empty where none does."""
    told = [(shares, n) for text, n in Counter(texts).items() if (shares := shares_of(text))]
    total = sum(n for _, n in told)
    mean: dict[str, float] = {}
    for shares, n in told:
        for name, share in shares.items():
            mean[name] = mean.get(name, 0.0) + share * n / total
    return mean
