"""The numbers that decide which clock a drive has, and whether a receiver contradicts itself: each
with its reason.

"Chosen" says of a number that neither a derivation nor a data sheet gives it, and what it weighs.
"""

from __future__ import annotations

# what clocks are

DRIFT_SD = 50e-6
"""Error of the rate of a host's clock: crystals of computers are cut to some tens of ppm."""
SENSOR_DRIFT_SD = 100e-6
"""The same of an IMU's. Chosen: twice a host's."""
MAX_RATE = 1e-3
"""A clock further off than this is broken or is not the clock it is said to be."""
GPS_SD_S, GPS_DRIFT_SD = 1e-3, 1e-9
"""Stamps that are GPS time already. Chosen: as good as the milliseconds they are often cut to."""
UNIX_SD_S, UNIX_DRIFT_SD = 0.1, 1e-6
"""A computer that is set over the network, now and then."""
TICK_S = 1e-3
"""Step of a logger's clock."""
LEAST_SD_S = 1e-6
"""No pair of columns ties two clocks better than their digits."""
MOST_SCATTER_S = 0.5
"""Two columns of one trajectory that scatter by more are not two clocks of one drive."""

# arrival of a receiver's epochs

EARLY_S, EARLY_PROBABILITY = 5e-3, 5.7e-7
"""An epoch that arrived so much before the least delay, and further than chance puts the edge so
rarely (five sigmas), has a wrong tag. Chosen: below 5 ms the waiting is not known so well."""
RATE_PROBABILITY = 2.7e-3
"""A clock is refused for its rate where chance moves the rate found so far so rarely: three
sigmas."""
UNSEEN = 0.04
"""Part of the median waiting by which the least delay may lie below all that was seen: with
lognormal waiting the lower edge is so thin that no few hundred epochs show it."""
STEP_ERROR_S, STEP_SHARE, RAISED_SHARE = 0.1, 0.1, 0.25
"""A step of so much in a clock is an error where the shorter part is more than a tenth of the
epochs: leaving that out would leave a part of the drive without a clock. A part that is raised may
be a busy host's, and is left out up to a quarter."""
WANDER_TOLD_S, WANDER_ERROR_S = 0.01, 1.0
"""A clock's departure from a straight line that is told, and the one that is refused. Chosen: at
20 m/s a hundredth of a second is 0.2 m, and a second is a clock that was set."""
LONG_WAIT_S = 1.0
"""Half of the epochs waiting longer is told: a receiver sends the next one by then."""
FEW, FEW_SD_S = 4, 0.05
"""Fewer epochs than this have no edge; one of them has waited for so long, as host and bus are."""
WANDER_PARTS, LEAST_WANDER_PARTS, PART_EPOCHS = 8, 4, 40
"""A wander is looked for in so many parts of so many epochs each: an edge needs some tens."""
WANDER_QUANTILE, WANDER_SPACINGS = 0.75, 4.0
"""It is what the upper quarter of the parts shows beyond so many spacings of the epochs near the
edge. Chosen: exponential waiting alone is beyond four in one part of 55 (exp(-4))."""
LOWEST_QUANTILE = 0.02
"""The lower edge of a cloud of delays as one sees it, but for wrong tags."""

# the lower edge

BACKGROUND, BACKGROUND_RANGE_S = 0.01, 1.0
"""Fraction of points with a wrong tag, before the data are seen, and how far off they are."""
SHAPE_SPREAD = 0.4
"""Of ln k about k = 1, exponential waiting."""
LOWEST_SHARE, LEAST_POINTS, MOST_POINTS = 0.2, 12, 120
"""The lowest points are used, within these counts: fewer say nothing of three unknowns, more lie
where no power law of the edge holds."""
BEND = 0.2
"""Of the width, from simulated gamma, Rayleigh and lognormal waiting."""
FLOOR_S = 2e-5
"""No host stamps bytes better than this."""
RAISED_WEIGHT = 0.35
"""A bin of delays above the line weighs so much, one below it the rest: a raised bin is a burst.
Chosen: half would be the median of the bins, which bursts raise."""

# steps

LEAST_STEP_S, STEP_SCATTERS = 0.02, 8.0
"""A step is larger than this, and than so many times the scatter of the levels. Chosen: smaller
ones are a wander."""
SIDE_BINS = 3
"""So many bins of time to each side show a level and its scatter."""
STEP_GAIN = 0.4
"""Two levels leave less than this part of the deviations that one leaves. Chosen: more would let a
clock that wanders have a step."""

# motions

IMU_GAP_S, IMU_GAP_STEPS = 0.25, 3.0
"""Readings further apart, and by so many steps, leave a hole in the integrals."""
SLOW_M_S = 2.5
"""A course is none below this speed: a velocity that errs by 0.2 m/s is turned by 5 deg there."""
FASTEST_M_S = 150.0
"""A faster vehicle is a wild fix."""
FIX_GAP_S = 2.5
"""Two fixes further apart are not of one motion: two are missing at one a second."""
LEAST_MOTIONS = 10
"""Fewer intervals show no motion that is worth comparing."""
MODEL_SD_S = 0.01
"""What springs and tyres add to a lag."""
ARM_SD_M = 1.5
"""The antenna ahead of the rear axle."""
SLIP_SD = 3e-3
"""rad/(m/s^2), sideslip by lateral acceleration."""
HUBER_SD = 2.0
"""Residuals beyond so many sigmas count less, as the fixes that jump are. Chosen: receivers'
velocities err for seconds in a row, which a wider limit would let decide."""
CORRELATED_S = 10.0
"""Residuals may be correlated over so long. Chosen: longer than the one to three seconds in a row
for which recorded receivers' velocities err."""
LEAST_INTERVALS, MOST_INTERVALS = 20, 4000
"""Intervals for a lag: fewer leave nothing after seven regressors, more add time and little."""
COARSE_S, FINE_S = 0.04, 0.012
"""Steps of the search for a lag: below what a second's window blurs, then a parabola's."""
LAG_REACH_S = 0.8
"""The IMU's delay is searched this far to both sides."""
SEGMENT_S, MOST_SEGMENTS, SEGMENT_NATS = 60.0, 12, 5.0
"""A drift is seen from lags of parts of the drive, each of a minute and worth odds of 150 to 1."""
PIECE_S, MOST_PIECES = 30.0, 24
"""Clocks are compared in pieces so long or, of a long drive, in so many. Chosen: half a minute of
town holds a bend or a stop, and more pieces tell a jump no better."""
SIDE_PIECES = 2
"""So many pieces to each side of a change at least: one alone may be mistaken."""
LAG_SCATTER, SCATTER_PIECES = 2.0, 8
"""How much more lags of pieces scatter than by their sigmas, and how many pieces of the drive at
hand that is worth. Recorded cars, with geodetic receivers and phones: 1.5 to 3 times."""
CHANGE_PROBABILITY = 1e-6
"""A steady clock is said to jump or to run off so rarely."""
MISTAKEN_LAG = 0.03
"""Part of the pieces whose lag is that of some other motion. Of 100 pieces of fifteen recorded
drives three are off by more than a second, of a telephone's and of a slow logger's."""
GAP_WITHIN_DRIVE_S = 3600.0
"""Drives of one log that lie further apart are searched one by one, and the days between them are
not integrated through: steps of them would fill the memory."""
OFFSET_STEP_S, APART_S = 0.2, 5.0
"""Step of the search over all offsets; peaks nearer than five seconds are one."""
LEAST_OVERLAP_S, LEAST_OVERLAP = 20.0, 0.3
"""Common time that two recordings must have under an offset, s, and of the shorter one: chance
finds better agreement the shorter it is."""
PREDICTED_S = 0.15
"""Receivers predict: velocities of recorded ones are ahead of their positions by no more. What is
further ahead has positions that are late, for no velocity is measured before it is driven."""
SOUND_TURN_SD = 2e-3
"""rad, by which a sound receiver's courses are turned over a drive: its velocities know no north of
their own, and ones that a program made of positions on a sphere are turned by half of what the
ellipsoid's two radii differ by, 0.19 deg at the equator, by azimuth."""
CERTAIN_LEAD_NATS, CERTAIN_NATS = 14.0, 25.0
"""An offset stands out by odds of a million over the next (ln 1e6 = 13.8), and over chance by so
much that a million offsets may be tried as well."""
WRONG_CLOCK_NATS, DOUBTED_CLOCK_NATS = 40.0, 10.0
"""By how much the motions must speak against a stated clock to refuse it, or to say so. Chosen:
refusing a right clock loses the drive, so more than for certainty is asked."""
STATED_REACH_S = 60.0
"""About a stated clock the offset is searched so far: leap seconds and wrong settings."""
STATED_OFF_S = 1.0
"""A clock off by less is one that lags, by more a wrong one."""
SMOOTHED_S = 2.0
"""A telephone's filter of places and speeds, once a second, lags by one to two of its steps: fixes
that show the motion so late are no wrong clock, and the drive need not be lost. Chosen."""

# a receiver's own filter

FILTER_STEP_S = 0.02
"""Motions are filtered in such steps: a twelfth of the shortest filter that is looked for."""
FILTERS_S = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
"""Time constants that are tried, a factor of the root of two apart: from a quarter of the second
over which motions are compared to half as much again as ``SMOOTHED_S``, which rounds a bend of a
street to nothing."""
SCREENED_FILTERS_S = (0.5, 1.0, 2.0)
"""Those tried first: with the right one between two of them either explains most of it."""
FILTER_INTERVALS = 1500
"""Most intervals that tell a filter: a bend of each few seconds of half an hour."""

# velocities against positions

POSITION_NOISE_M = 0.5
"""Of a coordinate from fix to fix, one sigma. Recorded receivers smooth theirs and show less."""
WANDER_SD_M, WANDER_TAU_S = 3.0, 60.0
"""What lasts of a position's error. Recorded receivers wander by 1 to 5 m over a minute."""
VELOCITY_ERROR_SD, VELOCITY_ERROR_TAU_S = 0.3, 2.0
"""Of a component, m/s, and for how long: recorded receivers' velocities err by 0.2 to 0.3 m/s for
one to three seconds in a row."""
DELAY_SD_S = 0.5
"""How late a velocity is against the position of its epoch. Recorded receivers' speeds are late by
0.1 to 0.7 s, their courses by 0.3 to 0.65 s."""
BEST_VELOCITY_SD = 0.03
"""No receiver's velocity is taken to be better, m/s a component, as in the fusion
(``min_velocity_sd``)."""
LEAST_DIGIT = 1e-3
"""Velocities are printed in mm/s at best: none agrees with anything more closely."""
MOTION_LASTS_S = VELOCITY_ERROR_TAU_S
"""A change of speed or course lasts for about as long as a receiver's velocities err in a row."""
LONG_WINDOW = 1.6
"""A window that is longer by such a factor than wanted spans a gap."""
WINDOW_S, LEAST_WINDOWS = 4.0, 5
"""Over so long the two are compared, and so many times at least. Chosen: at 5 m/s the way is ten
times what either errs by, and a change of speed is not yet over, which tells a delay."""
INTEGRATION_S = 0.1
"""Longest step of the integral of speed and course: in a tenth of a second neither bends."""
COURSE_SHARE, FAST_QUANTILE = 0.05, 0.9
"""A speed below this part of the drive's fast ones, whatever their unit, has no course."""
MATCH_ROUNDS = 8
"""Reweighting has settled by then."""
ANY_LOG_SCALE, ANY_TURN_RAD, ANY_LAG_S = 3.0, 0.5, 1.0
"""Scale (up to 20 times wrong), turn and delay before the data are seen, one sigma each."""
KNOWN_LOG_SCALE_SD = 0.1
"""A scale that is less sure tells no unit from another and is none."""
KNOWN_SHARE = 0.3
"""An estimate is none whose sigma is not smaller by so much than before. Chosen: the data then say
ten times as much as what was supposed."""
MOST_LAG_S, LAG_GRID_S = 5.0, 0.5
"""Delays are searched this far to both sides, in steps within which the paths' distance is smooth:
a change of speed lasts longer."""
LEAST_PART_M = 0.01
"""No two paths over a window are nearer than the digits of positions and of speeds make them."""
SOUND_SCALE_SD = 0.02
"""Relative error of a sound receiver's speed over a drive. Chosen: slopes and smoothing take off
less than a hundredth, and the least mistake of a unit, miles per hour as knots, is 15 %."""
TOLD_AGAIN_M, TOLD_AGAIN_SHARE = 1.0, 0.5
"""Five steps of coordinates with four decimals of a minute, 0.19 m, the coarsest that are usual:
after so much way no position is the same again, with its speed and course. Where most rows are, the
log is written faster than the receiver measures; a tunnel repeats less."""
EVEN_STEP, MOVED_DIGITS, MOST_BETWEEN = 0.1, 4.0, 49
"""Rows are evenly apart to a tenth of their step, as receivers tag them. What moved by fewer digits
lies on any line. Up to so many rows are put between two fixes: 50 a second of one."""
STRAY_SHARE = 0.02
"""Of rows that are measured where others are not. Chosen: a row that was lost, or came twice."""
SPEED_DIGIT, COURSE_DIGIT_RAD = 0.03, 1e-3
"""Speeds are told to a tenth of a knot and courses to a tenth of a degree at least, half of which a
way on from a fix errs by."""
LEAST_REPEATS = 3
"""A value must repeat so often to be looked into: one that is told with few digits repeats once or
twice by chance."""
HARD_BRAKING = 12.0
"""m/s^2: more than tyres hold on a dry road."""
STEP_SD_M = 2.0
"""By how much a sound receiver's positions step, m one sigma of a coordinate. Recorded ones step by
metres as satellites come and go."""
MOST_OF_DRIVE = 2.0 / 3.0
"""Of the places between which positions jump that one is believed where they are for so much of the
drive. Chosen: twice as long as in all others, for reflections last less than a view of the sky."""
JUMP_EVERY_S = 30.0
"""Positions of a receiver that stands jump at most so often. Chosen: as satellites come and go."""
FEW_STEPS = 5
"""Latitudes, and longitudes, that differ: of numbers with five decimals ten end at the fourth by
chance once in 1e10 drives, of those with seven once in 1e30."""
ROUNDED = 1e-5
"""Parts of a step within which a number, radians between, is the one that was written."""
COURSE_STEPS_DEG = (90.0, 45.0, 22.5, 15.0, 10.0, 5.0, 2.0, 1.0)
"""Sectors of a compass's rose and of displays, and whole degrees."""
COURSE_DIGIT_DEG, LEAST_SECTORS = 0.051, 4
"""A course is written to a tenth of a degree, and its direction is then within half of that. Twenty
of them lie all so near to whole degrees by chance once in 1e20 drives; of fewer sectors a drive on
a street and back may be."""
HELD_TURN_RAD, HELD_SHARE = 0.26, 0.5
"""Within two seconds positions turn by 15 deg or more in bends; a course that was measured is the
same to a twentieth of a degree in one of three hundred, and one of a road's pieces, 60 m long, in
two of three. More than half is most: a phone whose filter holds its course while positions wander
has it in a third (``iphone-austin``)."""
PARTING_S = (0.0, 4.0, 16.0, 64.0)
"""Over so long positions and velocities are compared where they may contradict each other: from
epoch to epoch, and up to the time that a receiver's error wanders in."""
CLIMB_WINDOW_S = 10.0
"""Heights change by metres in it on a slope."""
VERTICAL_FACTOR = 1.5
"""How much worse than level a receiver is in height: the usual dilution of precision."""

# axes of an IMU

AXES_WINDOW_S = 2.0
"""Changes of course and speed are taken over so long: a bend or a stop, and longer than delays."""
AXES_LAG_S, AXES_LAG_STEP_S = 1.5, 0.1
"""Lags of receiver and clock are searched so far: phones tell courses up to 0.7 s late and rough
clocks err as much; a step is a small part of the window."""
USUAL_CHANGES = (1.0, 99.0)
"""Percentiles beyond which changes count as these. Chosen: bends of a drive are more than a
hundredth of it, jumps of a receiver fewer."""
WILD_QUANTILES = (5e-4, 1.0 - 5e-4)
"""Readings beyond count as these: single wild ones must not decide."""
TILT_STEP_S = 4.0
"""Tilts are compared over so long: at 10 m/s roads change their slope meanwhile, and gyros drift by
a tenth of a degree only."""
FAST_WINDOW_S, FAST_STEP_S, FAST_GRID_S = 0.5, 1.0, 0.2
"""Springs swing at 1 to 2 Hz: mean forces over half a second, their changes over one, five times a
second."""
TILT_TURN_RAD = 0.2
"""A turn is small up to this: the next term is a tenth of it."""
SHOCK_SIGMAS = 3.0
"""Changes of force beyond count as these: shocks of the road."""
MOST_CORRELATION = 0.999
"""No two sensors agree better than by their errors of scale and axes."""
AZIMUTH_STEP_RAD = 0.0872664625997165
"""5 deg: the cosine of half of it is within a thousandth of one."""
TILT_SD = 0.20943951023931953
"""12 deg: how far gravity lies off the down axis of a sensor that is mounted by eye in a car that
leans on a sloping road, one sigma. Chosen: wrong axes are off by 90 deg or 180."""
MISTAKE = 0.01
"""Part of the manifests with a certain kind of mistake. Chosen: seldom, but known from experience;
ten times as many change a verdict by two nats."""
NEIGHBOUR_S = 0.3
"""Windows whose starts are no further apart differ by noise: a vehicle whose acceleration changes
by 1 m/s^2 from one end of them to the other shows 0.3 m/s."""
TURN_UNEXPLAINED, SURGE_UNEXPLAINED = 0.8, 0.9
"""Turns times speed and changes of speed over ``AXES_WINDOW_S``, m/s one sigma, that readings of
one vehicle leave open at most. Recorded cars: 0.05 to 0.78, the most where a receiver's filter lags
behind by a second, and 0.1 to 0.92, the most of hills."""
AS_GOOD = 0.01
"""A hypothesis with a hundredth of the best one's odds is told beside it."""
LEAST_SHARE = 0.25
"""Of the turns and speed changes that readings explain in any axes: with less they are no measure
of them, as on foot."""
CLIMB_WAY_M, LEVEL_ROUNDS = 200.0, 5
"""Slopes are taken over so much road: a hill's length, over which heights that err by two metres
tell it to a degree. Chosen: weights settle in so many rounds."""
MOUNT_SCATTER_RAD, MOUNT_SCATTER_PIECES = 0.01, 8
"""A fixed IMU's level of half a minute scatters by so much from piece to piece, rad an axis, and
how many pieces of the drive at hand that is worth. Fifteen recorded drives: 0.0095 in 115 pieces,
up to 0.02 in one of them."""
LOADED_RAD = 0.05
"""A fixed IMU turns by no more, 3 deg: who gets in or out pitches a body by one or two, and a bias
that changes by 0.15 m/s^2 as it warms up is another."""
LEVEL_S, LEVEL_M = 120.0, 500.0
"""Heights are told to a decimetre and err by decimetres from one fix to the next: not two minutes
of them are one number, on whatever road."""
HEIGHT_HELD_S, HEIGHT_HELD_M = 20.0, 100.0
"""Heights told to a decimetre stayed for 4 s and 113 m at most in recorded and simulated drives,
with and without a barometer: not for five times as long, on whatever road."""
BEND_S, BEND_SIGMAS, LEAST_BEND_M, STRAIGHT_SHARE = 1.0, 5.0, 0.1, 0.2
"""Three positions a second apart lie 1.6 m off a line in a street corner. One of a bend by five
sigmas or more, and decimetres, is by chance as near to it as a fifth of that at four: never."""
BEND_ENDS, DRIVING_M_S = 0.05, 2.0
"""Part of a bend of four seconds at whose ends velocities that are a tenth of a second early or
late tell a bend where there is none. Slower than walking there is no course."""
