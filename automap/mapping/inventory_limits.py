"""The numbers that decide a comparison with an inventory, and why each is what it is."""

from __future__ import annotations

STALE = 0.05
"""Of an inventory's signs, those that are gone, that stand elsewhere by now, and that are of
another class, before the data: chosen, as registers that are looked after are right in 19 of 20."""
NEW_SHARE = 0.1
"""Of a map's signs those that no inventory has, before that is estimated. Chosen."""
DETECTION_PRIOR = (8.0, 1.5)
"""Beta parameters of how often a sign in view is on the map: that of merged maps."""
USUAL_SD_M, USUAL_PAIRS = 2.0, 0.5
"""Error of an inventory's position per axis, before the data: chosen, about what aerial
pictures are digitised to. It counts as half a sign, so that the first signs outweigh it."""
LEAST_SD_M = 0.15
"""What a post and a face on it, or the two ends of a face, differ by."""
LARGEST_SD_M = 6.0
"""Where signs stand some ten metres apart, worse positions cannot be told from moved ones."""
ROUNDS = 40
"""Of the expectation maximisation; the sd settles to a centimetre in some twenty."""
