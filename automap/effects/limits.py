"""The numbers that decide how effects act, beside their own parameters, and why."""

from __future__ import annotations

COURSE_SPEED = 1.0
"""m/s; below it a direction of travel means nothing and is held, and a vehicle slides aside by no
more than it would at this speed. Velocities that err by a decimetre a second turn it by 6 deg."""
NOSE_SLIP_DEG = 0.25
"""By which a vehicle's nose is off its course for minutes: camber, side wind, axles out of line.
Measured on six drives of one day with a reference, root mean square: 0.28 deg, less the reference's
own 0.1; drives of two other days have 0.17 and 0.40. A camber of 2 % alone makes some 0.1."""
MOVING_SPEED = 0.5
"""m/s; a vehicle that stands has no direction of travel: an offset of speeds has half of its size
at half of this. Chosen: below a walking pace, ten times what phones tell of a car that stands."""
AROUND_S = 0.3
"""s; for so long before and after a fix others tell where it travels: both sides of a turn err
alike, and what the quickest begins to turn within is hundredths of a rad (0.5 rad/s^2)."""
REFERENCE_C = 25.0
"""A temperature that nobody measured: data sheets state their figures at it."""
FORCE_S = 0.05
"""Forces and rates are averaged over so much (one sigma of a Gaussian) where effects depend on
them: the vehicle's motion stays, vibration goes."""
BLEND_S = 1.0
"""Forward acceleration is the force's own for what is faster than this, and the change of the
fixes' speed for what is slower: a force has bias and slope in it, and fixes come once a second."""
LEAST_STEP_S = 0.005
"""Widths of averages count steps of at least this. Chosen: faster stamps are doubled ones."""
OUTLIER_M = 25.0
"""How far off, in a random horizontal direction, a position of ``gnss_outliers`` is. Chosen: a
reflection off a house across the street."""
DEAD_FORCE = 0.1
"""m/s^2; by so much a reading must differ from zero before a dead zone has taken all that it takes.
Zeroes of consumer accelerometers are known to a few hundredths of a g (MPU-6050: 0.05), and braking
and bends are ten times as strong."""
DEAD_RATE = 0.01
"""rad/s, as for forces: zeroes of gyros are known to half a degree a second once a car has stood,
bends turn by 0.1 rad/s and more."""
WARM_UP_S = 120.0
"""A sensor on its circuit board comes to the temperature of the housing in minutes, with this time
constant. Chosen; where it is another, a formula ``exp(-time / ...)`` says so."""
