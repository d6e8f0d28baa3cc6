"""The numbers that decide what wheel speed is worth and when it is believed; see ``limits``."""

from __future__ import annotations

import math

from automap.effects import CATALOGUE
from automap.fusion.limits import MAX_DELAY_S, ROAD_ACCELERATION_PSD

# vehicle and wheels

SPRINGS = 2.0
"""How much larger than the slip of tyres what a body does on its springs is."""
WHEELS_SPACING_S, WHEELS_MEAN_S = 0.25, 0.1
"""Wheel speeds that come faster are taken so often, each the mean over the second: their errors
last longer than that (slip, a wheel out of round, a step of the counter), so that more of them
tell no more, and a change of acceleration by 10 m/s^3 is 4 mm/s off such a mean."""
WHEELS_SLIP = 0.005
"""Share of the speed, over one second, by which wheels slip and tyres change their size. Measured
on the CAN speed of a recorded car: a seventh of a percent that lasts some eight seconds."""
WHEELS_JITTER_S = 0.02
"""Scatter of their stamps: an answer takes up to 50 ms (P2 of SAE J1979) and may wait as long again
in the phone that asks, which are two uniform waits, 50 ms / sqrt(6)."""
WHEELS_DEADBAND = 0.2
"""Slower wheels give no pulse in time and are said to stand, m/s: a toothed wheel of 48 teeth and
2 m around sends one every 4 cm, and messages come up to a fifth of a second apart."""
SLOW_WHEELS, FASTEST_REVERSE = 0.7, 5.0
"""Wheel speeds without a sign: below the first, m/s, they may be either way, so unsure are
directions while manoeuvring; faster than the second nobody reverses."""
MAX_WHEELS_S = 3.0
"""Wheel speeds later than this, s, are stamped by another clock: an ELM327 adapter waits up to
0.2 s for an answer (data sheet, AT ST), 3 s for fifteen values one after another."""

# wheels against the receiver

LOOK_WHEELS_S = 10.0
"""Delays of wheel speed are looked for up to this, s, to name them; none is used beyond
``MAX_WHEELS_S``."""
FASTEST_WHEELS_HZ = 1e4
"""No message comes so often: a CAN bus of 1 Mbit/s has room for some 8000 of 8 bytes a second."""
WHEELS_APART, WHEELS_UNLIKE = math.sqrt(ROAD_ACCELERATION_PSD[0] * MAX_DELAY_S), 0.5
"""Wheel speed is not this drive's where it is off by more, m/s and in the spread of its speeds: the
first is how road traffic changes its speed in the longest delay of a receiver, and speeds that have
nothing to do with the drive's leave the whole spread of them, of which the second is half."""

STEP_VALUES, LEAST_STEP = 8, 0.005
"""Different speeds from which a step is told, and the least one, m/s: less is how numbers were
printed, and an eighth of the wheels' noise."""
STEP_MISFIT = 0.1
"""Speeds miss the multiples of their step by no more of it (root mean square): any numbers at all
would by 0.29, and printed centimetres a second do by 0.01 of 1 km/h."""
WHEELS_GAP_S = 3.0
"""Wheel speeds further apart are not joined by a line: between them a speed is unsure by
sqrt(q T / 4), 0.9 m/s with the acceleration of road traffic."""
WHEELS_SCALE = math.log(1.2)
"""A tyre of another size turns by a tenth faster or slower at most, and a speedometer may show a
tenth too much (UN Regulation 39): beyond a fifth it is another unit."""
WHEELS_UNIT = 0.1
"""The logarithm by which a scale may be off that of a unit: the same tenth."""
MATCH_STEP_S, MATCH_POINTS = 0.1, 5_000
"""Delays are tried so far apart, s, on so many instants at most: a car's speed is straight over
some tenths of a second."""
SURE_WHEELS_S = CATALOGUE["odometer_time_offset"].parameters[0].prior_sd
"""A delay found by comparison is where to begin if its sigma, s, is less than that of the filter's
own beginning; a drive at one speed shows none."""
MATCH_CORRELATED = 2.0
"""Errors of neighbouring speeds resemble each other: sigmas are those of a quarter of them."""
STEADY_ACCELERATION = 0.3
"""Up to this, m/s^2, the noise of wheels is told: a delay of a tenth of a second adds 0.03 m/s."""
STUCK_S, STUCK_EDGE_S = 2.0, 0.5
"""A counter hangs that long at least, s; that much at its ends is not compared, for stamps may be
late by it."""
STUCK_CHANGE = math.sqrt(ROAD_ACCELERATION_PSD[0] * (STUCK_S - 2.0 * STUCK_EDGE_S))
"""Beside noise and steps, m/s, by which a speed changes while a counter hangs: what road traffic
does in the shortest time of that kind that is compared."""
FASTEST_CHANGE = 12.0
"""No car brakes or gathers speed by more, m/s^2: tyres hold a little more than gravity."""
TURN_WINDOW_S = 0.5
"""Rates are averaged over so much where they tell a bend: vibration is none."""
