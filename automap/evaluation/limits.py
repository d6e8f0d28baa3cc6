"""The numbers by which recordings are called implausible and maps are judged, and why.

"Chosen" says of a number that neither a derivation nor a data sheet gives it, and what it weighs.
"""

from __future__ import annotations

import numpy as np

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
TURN_RATIO = 15.0
"""deg/s against rad/s is a factor of 57; noise and a poor match stay well below 15."""
STRONGEST_TURNS, STRONGEST_RATES = 0.98, 0.99
"""Quantiles that stand for the strongest turns, and rates: the largest are a jump or a shock."""
LEAST_TURN, LEAST_TURNS = 0.02, 10
"""Turns of a course are compared with the gyro's if the strongest exceed this, rad/s (a curve of
500 m at 36 km/h), and there are so many."""
LARGEST_RATE = 6.0
"""No car turns faster, rad/s: once around in a second."""
WHOLE = 0.7
"""Part of the fixes' span that the readings must cover to have seen the same turns."""

# axes

TILTED, STEEP = np.radians(12.0), np.radians(35.0)
"""Gravity this far off the down axis, rad, is a sensor mounted askew, and a wrong axis. Chosen:
roads and cars lean by some degrees, and axes are wrong by 90 deg or 180."""
TURN_WINDOW_S, STAMP_SLACK_S, LONG_WINDOWS = 2.0, 0.05, 1.5
"""Courses are compared over so much, or half as much again where fixes are missing: the time of the
readings is known to some tenths only. Stamps jitter by less than the slack, s."""
FAST_M_S = 3.0
"""A course is none below this speed."""
LEAST_WINDOWS = 20
"""Fewer pieces of a drive give no correlation: chance makes 0.22 of so many."""
SPEED_CHANGES, TURNS = 0.3, 0.05
"""Changes of speed, m/s, and turns, rad, scatter by so much where there are any."""
CLEAR_CORRELATION, WEAK_CORRELATION = 0.5, 0.2
"""What two sensors both saw correlates clearly; weakly it counts where the other axis agrees still
less. Chosen: noise and a wrong time lower it, a wrong axis makes it nothing."""

# readings that stick

AT_PEAK = 0.9999
"""Of its largest value, what a reading that sits there has at least: its resolution."""
STUCK_COUNT, STUCK_SHARE, STUCK_SIGMAS = 20, 2e-4, 3.0
"""So many readings at the largest value, such a part of all, and that beyond so many standard
deviations: then the range is too small. Chosen: single shocks may reach it."""

# maps

GATES_M = (1.0, 2.0, 3.0, 5.0, 6.0, 10.0)
"""Distances within which signs count as found."""
PAIR_GATE_M = 15.0
"""Errors, coverage and class accuracy are taken over the pairs within this distance."""

# a receiver's delays

GREATEST_DELAY_S, DELAY_STEP_S = 1.5, 0.02
"""Delays of velocities are looked for up to this, s, in such steps. Phones have up to 0.7 s; a step
is a decimetre a second where a car brakes hard, a tenth of what their speeds err by."""
LEAST_SPEED = 1.0
"""m/s; courses of slower vehicles mean nothing, see ``effects.limits``."""
