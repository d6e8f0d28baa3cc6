"""The numbers by which recordings are called implausible and maps are judged, and why.

"Chosen" says of a number that neither a derivation nor a data sheet gives it, and what it weighs.
"""

from __future__ import annotations

# units and stamps

GRAVITY_TOLERANCE = 0.25
"""A median specific force this near to gravity is gravity: driving moves it by a tenth, and the
nearest wrong unit, g, by a factor of ten."""
STEADY_PART = 0.5
"""Of the median force, what its mean direction must keep: gravity that was taken out keeps none,
a sensor fixed to a car all but some hundredths."""
SLOWEST_HZ, FASTEST_HZ = 40.0, 4e4
"""Rates that IMUs have. Chosen: a thousand apart, so that nanoseconds, micro- and milliseconds
cannot be taken for one another."""
STRONGEST_RATES = 0.99
"""Quantile that stands for the strongest rates: the largest are a jump or a shock."""

# maps

GATES_M = (1.0, 2.0, 3.0, 5.0, 6.0, 10.0)
"""Distances within which signs count as found."""
PAIR_GATE_M = 15.0
"""Errors, coverage and class accuracy are taken over the pairs within this distance."""

# truths

FAR_M = 30.0
"""Where path and fixes are both this far off a truth it is rather another drive's or of another
time. Chosen: half the distance of two crossings in a town, as for a path that is of no use."""

# a receiver's delays

GREATEST_DELAY_S, DELAY_STEP_S = 1.5, 0.02
"""Delays of velocities are looked for up to this, s, in such steps. Phones have up to 0.7 s; a step
is a decimetre a second where a car brakes hard, a tenth of what their speeds err by."""
LEAST_SPEED = 1.0
"""m/s; courses of slower vehicles mean nothing, see ``effects.limits``."""

# one sensor

MIXED_ROWS, MIXED_LEAST_SHARE = 32, 0.2
"""Rows that are looked at together, some tenths of a second, and the share of them that the rarer
of two sensors has: one at a fifth of the other's rate."""
MIXED_WINDOWS, MOST_MIXED_WINDOWS, MIXED_PART = 10, 400, 0.5
"""So many windows at least, and at most for the time they take, of which more than this part has
two kinds of rows with a gap between them that is wider than either: of normal noise hardly any."""
MIXED_STEPS = 4.0
"""That gap in steps of the readings: noise of less than a step has two values and none between."""
CHANGED_WINDOW_S, CHANGED_ROWS, CHANGED_LEAST = 2.0, 10, 10
"""Windows whose median is gravity's but for some tenths of it, of so many rows at least, and how
many are on either side: in twenty seconds a vehicle has braked and started."""
CHANGED_GRAVITY = 2.0
"""Gravity keeps its size; between two units it changes by ten or a thousand."""
CHANGED_RAD = 0.35
"""Gravity further off than before, 20 deg, is no road's: the steepest streets climb by 19 deg."""
CHANGED_SHARE = 0.9
"""Of the windows that keep to their side of a change. Chosen: what a bend or a hand makes of some
is no matter, and what has no sides has half of them off."""
