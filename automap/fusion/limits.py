"""The numbers that decide a fusion's result, and why each is what it is.

What a user may want to change is in ``options``. "Chosen" says of a number that neither a
derivation nor a data sheet gives it, and what it weighs.
"""

from __future__ import annotations

import math

from automap.records import FixType

# fixes

FIX_TYPE_FACTOR = {
    FixType.DEAD_RECKONING: 5.0,
    FixType.TWO_D: 2.0,
    FixType.THREE_D: 1.0,
    FixType.DGNSS: 1.0,
    FixType.FLOAT: 1.0,
    FixType.FIXED: 1.0,
}
"""How much worse than its own figure a fix of this type is taken. Chosen: no
satellites, or an assumed height, make errors of position that the figure may leave out."""
CEP_SIGMAS = math.sqrt(2.0 * math.log(2.0))
"""Half of what lies in a plane lies within so many sigmas an axis."""
UNKNOWN_HDOP = 99.0
"""From here on it was not computed: receivers write 99.99 for that."""
UNSTATED_SD_M = {
    **dict.fromkeys((FixType.NONE, FixType.DEAD_RECKONING, FixType.TWO_D), 1.5 / CEP_SIGMAS),
    FixType.THREE_D: 1.5 / CEP_SIGMAS,
    FixType.DGNSS: 1.0 / CEP_SIGMAS,
    FixType.FLOAT: 0.5 / CEP_SIGMAS,
    FixType.FIXED: 0.05,
}
"""What a position that states no accuracy errs by at least, m an axis, whatever its dilution: a
good receiver's figures (ZED-F9P, UBX-17051259: half of positions within 1.5 m alone and 1.0 m with
SBAS; carrier phases that are not fixed yet, half of that: chosen). A fixed one's sheet says 0.01 m
and 1 ppm of the distance to a base: 0.05 m is that at 40 km."""
ACCURACY_HELD = math.log(1.25)
"""A receiver's figure is held until it has changed by a quarter: less is jitter of the report,
and every change of it lets some of the wander be forgotten."""
JITTER_SIGMAS, JITTER_FIXES, MOST_JITTER = 4.0, 9, math.log(2.0)
"""Reports that scatter from fix to fix are held within so many of their sigmas, one in 16,000 is
not, about the median of so many, which is good to 0.4 sigma. A figure that halves or doubles is
another kind of solution, not scatter."""
LEAST_WHITE_M = 0.02
"""Chosen: from fix to fix no position without carrier phase is steadier than one with it."""
DOWN_FACTOR = 1.5
"""How much worse than level a velocity that states no accuracy is downwards, and the least error of
a position: dilution of precision is that much larger (Kaplan and Hegarty, Understanding GPS,
section 7.3)."""
VELOCITY_DELAY_SD_S, VELOCITY_DELAY_WINDOW_S = 0.2, 1.0
"""Receivers tell velocities of some instant of the last few tenths of a second, or a mean over
them; which is not known yet. So a velocity counts as unsure by its change in such a time, taken
over the window."""
ROAD_ACCELERATION_PSD = (1.0, 1.0, 0.1)
"""White acceleration of road traffic north, east, down, (m/s^2)^2/Hz: in a second the speed
changes by 1 m/s (one sigma), downwards by a third of that."""
OUTLIER_PROBABILITY = math.exp(-8.0)
"""A right fix is taken for wild so rarely: where it lies four sigmas off in the plane,
exp(-4^2 / 2), five times in an hour of four fixes a second."""
OUTLIER_SD = 2.0
"""Sigma of a wild fix in its own distances: it is then one of half a sigma, and pulls little."""
SCREENING_ROUNDS = 6
"""Chosen: a bound for fixes that are wild in one round and right in the next."""
UNKNOWN_LEAN_SD = 0.05
"""Roll and grade of a road and of a body on it that no IMU has seen, rad."""
LEAST_COURSE_SPEED = 0.3
"""Below that speed, m/s, a course is anything, and is not called less sure any more."""

MAX_DELAY_S, MAX_SKEW = 1.0, 0.01
"""Larger delays and skews are none, but an estimate that ran away."""

# surprise

MAX_INFLATION = 1e6
"""Factor on a variance at which a measurement, at a thousandth of its weight by sigma, is as
good as none: the search for a larger one ends."""
REFUSED_INFLATION = 9.0
"""A measurement whose sigma had to grow to three times itself is counted as refused."""

ARM_TOLD_SD_M = 0.3
"""An arm that nobody stated is estimated from positions this good, m. Receivers' own filters lag in
turns and err there by their accuracy, which looks like an arm: of an arm of a metre, the prior,
such fixes tell nine tenths of the variance."""
UNKNOWN_ARM_SD_M = 0.5
"""From the IMU to an antenna that nobody stated, m and axis. Chosen: none in a phone or a logger,
a metre from a box in the cabin to the roof."""

FIX_AGE_SD_S = 0.08
"""Fixes of navigation filters are of an instant so far from their tag's, s: of three recorded
receivers (two phones, a u-blox) 0.12 and 0.02 s ahead and 0.07 s behind."""
BETTER_KNOWN = 0.5
"""Where stamps are known so much better than the age of the fixes, a delay is theirs by a fifth at
most. Else it may be either's: readings of recorded cars are 0.05 and 0.16 s late, too."""
STATED_ARM_SD_M = 0.05
"""An arm to the antenna that was measured with a tape, m."""
HELD_ARM_SD_M = 1e-3
"""Of what is not to be told, in the filter, m: a fiftieth of that."""
MOST_ARM_M = 25.25
"""The longest road train that Directive 96/53/EC lets drive: a longer arm is in another unit."""

# nodes

MAX_NODE_SPACING_S = 0.5
"""No stretch between nodes is longer, so that interpolated uncertainty stays true."""
LEAST_SPACING_S, MOST_SPACING_S = 0.01, 1.0
"""What is noise per second is shared among nodes by their distance, within these."""
MOVING_SPEED = 2.0
"""Driving, where seconds of driving are counted, m/s. Chosen: more than creeping in a queue,
and many times what receivers report at rest."""
MIN_SPLIT_S = 0.02
"""Velocities get nodes of their own from this distance to their position: at 5 m/s^2 a nearer
one errs by less than the 0.1 m/s that a velocity is worth."""
LEAST_FIXES, FIX_EDGE_S = 2, 1.0
"""A path has two ends. Fixes count up to a second, the usual step of receivers, beside the
readings: clocks are known to some tenths before the fusion."""
LEAST_JUDGED = 20
"""Innovations from which a channel is judged: their rms is then good to 16 %."""
DOUBT_PROBABILITY = 1e-6
"""One test doubts a right drive so rarely: with some hundred tests a drive, one drive in ten
thousand."""

# standstill

STANDSTILL_WINDOW_S = 0.5
"""Scatter is taken over so much: several periods of an idling engine (10 Hz and more)."""
LEAST_STANDSTILL_S = 1.0
"""Chosen: shorter stops bring little, and a smooth road is as quiet for a moment."""
QUIET_FACTOR = 3.0
"""Scatter, in that of the quietest windows, up to which a vehicle stands. Chosen: less loses
standstills while the engine idles unevenly, more takes creeping for standing."""
QUIETEST_PERCENTILE = 10
"""Which of the slow windows are the quietest ones; not the minimum, which chance decides."""
QUIET_FORCE, QUIET_RATE = 0.3, 0.5
"""Shares of the scatter while driving below which a vehicle stands, whatever the slow windows
show: without them a drive that never stops would stand in its smoothest stretches."""
DRIVING_SPEED = 3.0
"""Above it, m/s, the scatter is that of driving."""
MOVES_PROBABILITY = 2.7e-3
"""A receiver's speed at rest is taken for motion so rarely: three of its own sigmas."""
LEAST_SLOW_SPEED, MOST_SLOW_SPEED = 0.15, 0.5
"""Limits in m/s of the speed that still counts as none, whatever sigma is stated. Chosen:
noise at rest comes to one or two decimetres a second, and half a metre a second is creeping."""
POSITION_SPEED_S, POSITION_SPEED_FIXES = 3.0, 2
"""Where a log tells no speeds they are those of its positions, from so many seconds before to so
many after, by so many of each at least. Chosen: white errors of 0.3 m, once a second, come to
0.06 m/s a coordinate then, and of a stop three seconds are lost at either end."""
FIX_REACH_S = 1.5
"""No standstill further than this from a fix: what a receiver that fixes once a second leaves."""
REST_BIAS_SD = 2e-3
"""How far the mean rate at rest is from the bias at the start, rad/s. Chosen: 0.1 deg/s, so that
a consumer sensor may warm up in between."""

# readings

SWAY_HZ = 5.0
"""Bodies sway on their springs at 1 to 3 Hz, and wheels hop at 8 to 15 Hz (Gillespie, Fundamentals
of Vehicle Dynamics, chapter 5): what is faster moves no antenna that a receiver sees,
but shakes the IMU."""
FLOOR_HZ, FLOOR_BAND_HZ = 20.0, 2.0
"""White noise of a sensor is told up to here, where its own low-pass begins (MPU-6050: 20 Hz
and more are usual), by bands so wide: of a minute each is good to a tenth."""
SPECTRUM_S = 4.0
"""Spectra of readings are over so long: four periods of the slowest swaying."""
STEADY_GAP_STEPS = 3.0
"""A step between stamps of so many usual ones is a gap: two samples are missing."""
SHORT_GAP_S, GAP_ROWS = 1.0, 20_000
"""Over a gap no longer than this the readings change as they do elsewhere in the drive, of which so
many rows tell it to a hundredth. Chosen: a bend or a stop lasts for seconds."""
MOST_LOST_S = 300.0
"""After so long without readings and fixes, in which a vehicle has moved, no state is left to go on
from: behind 373 s a filter came to the fixes again, behind 573 s it was not finite."""
SHOCK_WINDOW_S = 0.15
"""Scatter is taken over so much: a wheel that hops at some 10 Hz has one or two swings."""
USUAL_PERCENTILE = 75.0
"""Most of a drive is driving, and little of it is shocks."""
LEAST_SHOCK_RATIO = 4.0
"""Scatter grows and shrinks by less on any road."""
HALF_STEP_S = 0.05
"""Rates of change are taken over twice this time: vibration is no motion of the vehicle."""

WILD_WINDOW_S = 0.5
"""A wild reading is compared with the median over so much: bursts of up to half of it are found."""
MOST_RATE, MOST_FORCE = 6.0, 100.0
"""What no sound drive reads, rad/s and m/s^2: a spinning car turns once a second, and a crash
begins at ten g. Potholes stay below, however smooth the road beside them."""
USUAL_READINGS_PERCENT, WILD_RATIO = 99.0, 30.0
"""Off by this many times what one reading in a hundred is off by: with tails as heavy as 1/x^3,
which is that of potholes and joints, one reading in three million is. It is another unit else."""
FROZEN_S = 0.5
"""Six readings that do not change by a digit for so long were not read: a slow sensor in a quick
log repeats them for a tenth of a second."""
STRAIGHT_BEND = 0.01
"""A reading that is off the line between its neighbours by so small a share of what readings of the
drive usually are, in all six columns, was put there: noise does that once in 1e13 readings."""
JOINED_S = 0.25
"""Readings further apart are not joined where they are integrated by themselves: braking by 3 m/s^2
that nobody saw is 0.75 m/s in it, half of the least jump that is told."""
FROZEN_AXIS_S = 5.0
"""One coarse axis may rest at a value while others move, for a smooth second."""
CLIPPED_STEPS = 4
"""So many readings in a row at the very largest size are the end of the range: a peak of coarse
readings has two or three. Chosen."""
CLIPPED_PROBABILITY = 1e-6
"""Nor are they chance where readings stay at other values: an hour at 100 Hz has some ten thousand
changes of a coarse axis that could be such a run."""

# start

N_HEADINGS = 12
"""Headings that are tried, 30 deg apart. Chosen: fewer may miss the filter's way to the right
one, more take longer."""
SURE_MARGIN_NATS = 5.0
"""A heading is sure that is so much likelier than any other: odds of 150 to 1."""
UNKNOWN_HEADING_SD = 1.8
"""Spread of a heading that may be any, rad: pi / sqrt(3)."""
UNKNOWN_HEIGHT_SD_M = 1000.0
"""Spread of a height that no fix has told, m: any road but a few."""
LEVELLING_WINDOW_S = 10.0
"""Forces are summed over so much for the first level: a change of speed that the fixes miss
matters little against ten seconds of gravity, and a gyro does not drift away yet."""
TRIAL_MOVING_S, TRIAL_MAX_S = 45.0, 600.0
"""Headings are tried over so much driving, and over no more than so much of the drive. Chosen:
in a town that has a corner or a stop, which tell the heading; longer takes longer."""
START_TILT_SD = 0.12
"""The first level is good to this, rad: 1.2 m/s^2 of the force are of the vehicle."""
START_HEADING_SD = 0.6
"""Sigma of a tried heading in the distance of two: neighbours overlap at their sigmas."""
START_SD_M, START_WANDERS = 5.0, 3.0
"""The first position is this unsure, m, and this many of the fix's own wanders. Chosen wide: the
fixes that follow make it as good as they are."""
START_SPEED_SD, UNKNOWN_SPEED_SD, MOST_SPEED_SD = 1.0, 5.0, 15.0
"""Sigmas of the first velocity, m/s: of one that a fix at that instant tells, of one that none
does, and the most that one is unsure which came later (a vehicle in a town)."""
START_ACCELERATION, START_DRIFT = 3.0, 3.0
"""How much less sure velocity and position are for every second that the first fix comes late,
m/s^2 and m/s. Chosen: hard braking."""
TURNED_START_SD_M, TURNED_START_SPEED_SD, TURNED_HEADING_SD = 10.0, 2.0, 0.3
"""The start, m, m/s and rad, of a drive that was smoothed in the sensor's axes before: known far
better, but the passes that follow shall not lean on it."""

# mounting

MOUNTING_SPEED, MOUNTING_MOVING_S = 3.0, 10.0
"""Forward is where a vehicle goes above this speed, m/s, for so long at least. Chosen: a velocity
that errs by a tenth of a metre a second is turned by 2 deg then, and ten seconds average that."""
STRAIGHT_RATE, STRAIGHT_ACCELERATION = 0.1, 1.0
"""Up to this turn rate, rad/s, and change of speed, m/s^2, a vehicle drives straight on: in bends
an IMU that is not at the rear axle swings out, and braking pitches the body."""
FORWARD_BLOCK_S = 5.0
"""Directions of travel resemble each other over so long: independent ones are so far apart."""
LEAST_FORWARD_SD = 0.003
"""What no drive's length makes smaller, rad: body and road are not one plane."""
KNOWN_FORWARD_SD = 0.002
"""The same of a mounting that the filter has estimated, rad."""
OTHER_WAY_ANGLE, OTHER_WAY_MEDIANS = 0.02, 3.0
"""A direction of travel off the others by more than this many of their medians, and more than
this, rad, is reversing or a slide and is left out."""
TURN_RATE, LEAST_TURN = 0.08, 0.5
"""Faster is a bend, rad/s (a curve of 100 m at 30 km/h); in all so much of them to one side, rad,
tells something of the axis of turning."""
MAX_TURN_ROLL = 0.2
"""A roll beyond this from turns, rad, contradicts gravity: then gravity alone is believed."""
LEAN_SD, GRADE_SD = 0.03, 0.1
"""Lean of the body in turns, and change of grade over a corner of 90 deg, rad."""
ROAD_ROLL_SD = 0.02
"""Mean cross-fall and suspension lean of a drive, rad, one sigma: roads fall by 2.5 % to the side
for the rain."""
KNOWN_ROLL_SD = 1e-3
"""The roll of axes that nobody doubts, rad: no body is stiffer on its springs."""

# passes

DELAY_CONVERGED_S, SKEW_CONVERGED, CONVERGED_SIGMAS = 5e-4, 1e-6, 0.1
"""A delay, s, or skew that moves by less, or by a tenth of its sigma, has settled: half a
millisecond is 1.5 cm at 30 m/s, and 1e-6 comes to 3.6 ms in an hour."""
HEAD_S = 900.0
"""The first pass goes no further than this into the drive."""
SETTLED_TURN_RAD = 3e-4
"""An attitude that moves by no more leaves the likelihood as it is: where models are compared by
nats, a path that moved by 2e-3 moved it by 20 to 60, by 8e-4 by 6, by 4e-4 by 1, by 1e-4 by 0.1
(the phone's errors along ten minutes, seen)."""
MOST_REPEATS = 6
"""Passes at most about the path of another model. Chosen: bounds the time of one that wavers."""

# noise levels

STANDING_PART = 4.0
"""Standing counts at most so many times the driving that is wanted."""
REFINE_S = 600.0
"""So much driving the levels are refined on at most."""
LEVEL_SPREAD = math.log(4.0)
"""Data sheets and presets are right to a factor of four (one sigma of a level's logarithm)."""
TIME_FACTORS = {"wander_tau": (0.02, 16.0), "velocity_wander_tau": (0.25, 16.0)}
"""Between which factors it is looked for how long a receiver's errors last: of velocities from one
fix to a minute, since what lasts longer is an offset; of positions to a quarter of an hour."""
SHAKEN_SPREAD = math.log(2.0)
"""An accelerometer's noise is no less than what its readings differ by from one to the next, to
a factor of two (one sigma of its logarithm): 0.5 times in a recorded car, 1.0 to 2.3 beside laser
scanners, 2.0 of a telephone. More is no surprise: a filter hides what shakes."""
ABSENT = 1e-3
"""The factor of an error that is not there: 0.2 mm/s of the lasting error of velocities."""
LASTING_ODDS_NATS = math.log(19.0)
"""Of twenty receivers one has velocities without a lasting error. Chosen: of those recorded none
has, but good ones under an open sky may, and simulated ones do."""
REST_MEAN_S, REST_PAIRS = 0.5, 20
"""Noise at rest is told by the differences of neighbouring means over so much, the times that count
between fixes; from so many, whose median square is then good to a third."""
WORSE_FACTORS = tuple(2.0 ** (0.5 * k) for k in range(2, 8))
"""Times the usual that positions are looked for to err by in some stretches, a grid: less changes a
path little, and more is what is wild."""
WORSE_STAYS, WORSE_SHARES = (3.0, 6.0, 12.0), (0.05, 0.15, 0.3)
"""Windows that such a stretch lasts on average, and its share of a drive, grids: between one row of
houses and a part of a town, and less than half, since else it is the usual."""
