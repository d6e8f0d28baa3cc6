"""Probabilities as people read them."""

from __future__ import annotations


def belief_text(probability: float) -> str:
    """Two decimals; what would round to certainty is "over 0.99"."""
    return "over 0.99" if probability >= 0.995 else f"{probability:.2f}"
