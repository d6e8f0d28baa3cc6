"""The numbers that decide a calibration's result, and why each is what it is.

"Chosen" says of a number that neither a derivation nor a data sheet gives it, and what it weighs.
"""

from __future__ import annotations

import numpy as np

from automap.effects import CATALOGUE

# what sensors are like, for the dynamic calibration: bias and scale of accelerometer and gyro

EFFECTS = ("accel_bias", "gyro_bias", "accel_scale", "gyro_scale")
"""What a hand can show in two minutes, in the order of the filter's states."""
PRIOR_SD = np.array([p.prior_sd for e in EFFECTS for p in CATALOGUE[e].parameters])
"""One sigma of the errors before: of the catalogue of effects (m/s^2, rad/s, and relative)."""
ANGLE_SD = CATALOGUE["accel_misalignment"].parameters[0].prior_sd
"""One sigma in rad of the accelerometer's three angles where the poses do not determine them: data
sheets of consumer sensors state 1 or 2 % between axes."""
TURN_ON_SD = np.repeat([0.03, 0.01, 0.001, 0.002], 3)
"""The same for a sensor that was calibrated statically: what changes from one turn-on to the
next (5 mm/s^2 and 0.1 deg/s are usual for consumer sensors; several times that is allowed)."""
WALK = np.repeat([5e-5, 5e-6, 0.0, 0.0], 3)
"""Random walk of the errors, per square root of a second: in the two minutes of a log it comes
to what consumer sensors have as bias instability, some 50 micro-g and 10 deg/h."""

# rests

WINDOW_S = 0.5
"""Movement is looked for in windows of this length: longer than the swing of a hand tremor."""
LEAST_REST_S = 1.0
"""Chosen: a sensor that is put down swings for a part of a second, and half of a second to either
side is not inside the rest."""
BATCH_S, BATCHES = 1.0, (4, 10)
"""A rest's means are as sure as those of its batches, which are longer than a hand's sway, of which
shorter ones show more than the whole has; and how many there are at least and at most."""
MANY_RESTS_S = 10.0
"""Rests of this length in all show whether the noise is correlated."""
SAME_POSE = 0.002
"""Neighbouring rests nearer than this, against the span of the readings, are one pose."""
FLOOR_QUANTILE = 0.05
"""The quietest twentieth of all windows is taken for the sensor's own noise."""
SMOOTH = 3.0
"""Variance over that by second differences: 1 for white noise, up to 2 behind a sensor's own
low-pass, hundreds for motion."""
THRESHOLDS = tuple(1.5 * 2.0 ** (k / 2) for k in range(16))
"""Candidate limits on windowed variance over noise floor, from 1.5 to 270."""
REST_HOLE_STEPS, TURN_HOLE_STEPS = 10.0, 2.5
"""Stamps further apart than so many steps are a hole: of a rest, which loses nothing by some
readings that are missing, and where readings are summed, which does."""
OUTLIER_PROBABILITY = 1e-3
"""A right rest among those of a log is left out so rarely (Bonferroni: shared among them all)."""

DRIFT_PROBABILITY, LEAST_SPARE = 1e-3, 3
"""A sensor whose zero stays is told to drift so rarely; and how many poses beyond the parameters
and a drift show how far off they are otherwise: of three, F is over 141 by chance so rarely."""

# poses and turns

LEAST_SINGULAR = 0.03
"""Smallest singular value of the design matrix per sqrt(pose) that counts as determined.

Six poses along the axes have 0.41 (six parameters), twelve over faces and edges 0.24 (nine);
poses in one plane have 0.
"""
HELPED_SINGULAR, UNEVEN_SINGULAR = 1.5 * LEAST_SINGULAR, 2.0 * LEAST_SINGULAR
"""Poses are proposed until they determine the parameters with something to spare, and are called
uneven up to twice what just will do."""
COVERED_AXIS = 0.7
"""Cosine to an axis (45 deg) up to which a pose stands for that axis."""
GOOD_POSES = 12
"""With fewer poses than this the errors hardly average out (the paper's K)."""
NOT_AT_REST = 0.01
"""Residuals above this part of gravity are no sensor's at rest."""
LEAST_TURNS, LEAST_TURNS_WITH_G = 6, 8
"""Turns for a gyro's calibration: gravity carried along one gives two numbers, twelve are wanted
and rests give the bias. With the g-sensitivity, nine more, the rests help too. Chosen: one or two
to spare."""
LOOSE_SCALE = 0.01
"""A gyro scale with a 95 % interval wider than this needs more turns about its axis."""
OWN_AXIS = 0.5
"""Of the strongest axis' part in a turn, what the gyro's axis of the same name must have: less is
another axis. Chosen: misalignments are some hundredths."""
TURN_SMOOTH_S = 0.2
"""Forces are averaged over so much for the first guess of a gyro: tremor, not the turn."""
ROUGH_SD = 2.0
"""Sigmas at which a window's residual, of a first guess or of an Allan deviation, counts half as
much by weight: windows with other accelerations are far beyond."""

# logs that no calibration can use

SATURATION_PROBABILITY = 1e-6
"""Chance of a run of equal extreme readings below which it is taken for saturation."""
LEAST_RUN = 4
"""Shorter runs are no saturation. Chosen: noise repeats a reading two or three times."""
CUT_OFF = 0.05
"""Of all readings' span, what a saturated run's neighbourhood spans at least."""
UNIT_RANGE = (0.8, 1.25)
"""Ratio of a scale or of gravity to what it should be, within which the unit is right: no sensor is
wrong by a quarter, and the nearest two units, g and m/s^2, differ by ten."""
RANGES = 8.0
"""From the least to the widest range that a sensor can be set to: 250 to 2000 deg/s, 2 to 16 g, in
steps of two."""

# dynamic calibration

UPDATE_S, MOST_UPDATES = 0.1, 12_000
"""A hand's motion is slower than this step; measurements are taken more rarely in logs of hours."""
PASSES = 4
"""The hand's motion and the errors are found in turn so often. Chosen: a bound, the last ones
change little."""
LEAST_LOG_S = 10.0
"""Chosen: turning about three axes takes longer."""
STILL_LIMIT = 8.0
"""Movement (variance over noise floor) below which the pseudo-velocity counts as exact."""
STILL_SD = 0.003
"""What is left of a velocity that counts as exact, m/s. Chosen: a table that is touched."""
LEVEL_SD_REST, LEVEL_SD_MOVING = np.radians(0.05), np.radians(15.0)
"""How well the first second levels the sensor beyond its biases: at rest noise alone, in the hand
accelerations of a quarter of gravity."""
START_SPEED_REST, START_SPEED_MOVING, START_PLACE_M = 0.005, 0.3, 0.3
"""Sigmas of the first velocity, m/s, and place, m: a sensor on the table, and one in a hand."""
LEAST_TURN = np.radians(270.0)
"""A sensor turned less than this about an axis tells little of that axis."""
MUCH_TRANSLATION = 0.5
"""RMS velocity of the hand, m/s, above which the result is poor."""
WELL_KNOWN = 0.5
"""An error is determined when its sigma falls below this part of the prior's."""
OTHER_SENSOR_PROBABILITY = 1e-6
"""So rarely is a right calibration, its sensor's errors normal with the sigmas above, taken for
that of another one."""

# the hand

SLOW_HZ = 0.5
"""What the sensor's errors do to its place, while it is turned in a second or two, is slower."""
PEAK_PART = 0.25
"""Of the spectrum's peak, what the place's noise is at least: a hand that hardly moves slowly would
else be followed in its sway."""
LEAST_MEASUREMENTS = 50
"""Fewer give no spectrum."""
LEAST_VELOCITY, LEAST_PLACE = 0.01, 0.01
"""Never less noise than this, m/s and m: the filter is linear only so far."""
SMOOTH_HZ = 0.1
"""Spectra are averaged over this band: some ten frequencies of a two-minute log."""

# Allan deviations

LEAST_TAUS, LEAST_SAMPLES = 8, 500
"""Averaging times and samples of a deviation that three terms are read off."""
MODEL_SD = 0.05
"""Three terms are no better than this, relative, however sure the deviation is: quantisation and
low-pass at the short end."""
LONG_REST_LIMIT = 20.0
"""Movement (variance over noise floor) above which a sample does not belong to a rest of hours;
more than in the hand, for the floor of a long log is that of its quietest twentieth."""
SHORT_S = 600.0
"""A shorter rest shows white noise only: bias instability of consumer sensors is lowest at some
hundred seconds, and the deviation is good to a fifth of the record."""
MOST_LEFT_OUT = 0.05
"""A rest that leaves out more than this part of the log is told."""
