"""How surely a hand puts signs, and how far one is looked for."""

from __future__ import annotations

MATCH_M = 15.0
"""A reviewed sign is looked for within this distance of where it was. Chosen: more than a new run
moves it."""
HAND_FACING_SD_DEG = 5.0
"""One sigma of a facing set by hand. Chosen: about what a direction is read to in a picture from
the air, a tenth of the right angle between two roads."""
HAND_HEIGHT_SD_M = 0.2
"""One sigma of a height above the road set by hand. Chosen: about what it is told to beside plates
of known size, a third of one."""
HAND_SD_M = 1.0
"""One sigma, per axis, of a position set by hand where the action gives none. Chosen: about what
aerial pictures are placed to."""
