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
