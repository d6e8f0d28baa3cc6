"""The numbers that decide when a path is doubted, and why each is what it is; see ``limits`` of
the fusion."""

from __future__ import annotations

from automap.earth import STANDARD_GRAVITY

TOLD_SHARE, ADDED_SHARE = 0.25, 0.2
"""A part of a drive tells a constant whose variance it brings down to this share, and the rest adds
to it what takes a sixth away from what is left. Chosen: a sigma of half, and more than rounding."""
PIECE_S = 5.0
"""Estimates are compared in pieces of so long: velocities of recorded phones err alike for two to
four seconds."""
ODDS_STEP = 0.5
"""Steps of the logarithm: two instants' differences correlate by exp(-0.25) at least, 0.78, as a
Brownian bridge's do, and a change between them is told by 0.88 of its size."""
CHANGE_PROBABILITY = 1.0 / 29.0
"""An age changes within a drive so often: of 27 recorded pieces none is known to, and the next one
does by Laplace's rule of succession."""
LEAST_OWN, LEAST_FREEDOM = 0.05, 1e-3
"""Against a quotient of nothings where one piece tells all."""
MINUTES_OFF_M = 0.4 * 111_200.0
"""Minutes of arc that were read as hundredths of a degree, or the other way round, are off by up to
0.4 deg, of which one is 111.2 km."""
LEAST_AGE_S = 0.15
"""Fixes of real phones and receivers seem to come from the future by so much: they predict."""
AT_BOUND = 0.99
"""An estimate this near its bound has run to it."""
MOST_SENSOR_ERROR = {
    "accel_scale": (0.1, "", "the scale error of the accelerometer"),
    "gyro_scale": (0.1, "", "the scale error of the gyro"),
    "accel_bias": (1.6, " m/s^2", "the bias of the accelerometer"),
    "gyro_bias": (0.7, " rad/s", "the bias of the gyro"),
}
"""Twice to three times what data sheets of cheap sensors state (MPU-6050: scale 3 %, zero offset
80 mg and 20 deg/s)."""
REFUSED_SHARE = 0.2
"""Chosen: of measurements of one kind, one in five is not chance and no single outlier."""
USELESS_SD_M = 30.0
"""Chosen: half the distance of two crossings in a town; beyond it a sign is on some street."""
SMALL_SIGMAS = 2.0
"""Sigmas are doubted that are so many times too small: three of them are then one and a half."""
ROLL_ARM_M = 1.1
"""Root mean square of an IMU's height above the road, from a car's floor, 0.3 m, to its roof,
1.7 m, each as likely."""
STRETCHES_S = (20.0, 60.0, 300.0)
"""Path and fixes are compared over stretches of so long, and the whole drive: a street, what an
error of a receiver lasts, and what biases make. Chosen: shorter says little, for a slow error of a
few seconds is a receiver's, and a path is right to pass it by."""
FILLED_STRETCH = 0.8
"""A stretch is judged that has fixes over this share of it: not one with a hole at its end."""
WILD_MISS_SIGMAS = 8.0
"""A fix counts as no more than this many sigmas off: one wild fix among twenty is then less than
half of one in the mean, and a stretch of wild ones is still beyond any gate."""
WORSE_SHARE = 0.5
"""Chosen: where more than half of the fixes lie far off the path, the path is not theirs."""
BLAMED_SHARE = 0.1
"""The same where something else speaks against the inertial sensor, too. Chosen."""
AGREEING_SHARE = 0.1
"""Chosen: fixes agree with one another where nine in ten lie on their own smoothed path."""
HELD_S = 5.0
"""Chosen: a receiver without a view repeats its last fix for some seconds, and goes on."""
STEP_WINDOW_S, STEP_FIXES, STEP_BATCH = 3.0, 3, 2000
"""A velocity jumps against that of so long before and after, of so many fixes at least: receivers
err for one to three seconds in a row and are right again. So many are looked at at once."""
UNHELD_PROBABILITY = 1e-3
"""What stated errors make so rarely they do not hold; as for a measurement that is refused."""
BODY_PITCH_RAD = 0.02
"""By which a body is off the road's slope while a car brakes or speeds up by a third of gravity:
bodies pitch by two to four degrees for one of it."""
LEAST_USUAL, MOST_USUAL = 8, 400
"""Jumps over holes are compared with those of so many stretches without one: by a sigma of four
degrees of freedom, which makes a doubt of nothing that is less than 50 of it off. A median of more
than 400 is good to a twentieth already."""
OVER_HOLE_PROBABILITY = 1e-3
"""A jump over a hole is rather a change than chance below this: where one hole in a hundred has
one. Chosen; a slow vehicle's 4 m, which chance makes once in thirty times, would else count as
half a second, and as 15 m where it drives fast."""
REGAINED_SD_M = 0.1
"""A filter is led astray by so much an axis, m, where only positions to decimetres and velocities
made of them are told: 0.17 m in the one such stretch recorded, of 2 s."""
STRAIGHT_RAD = 0.1
"""A way that turns by less is straight: 6 deg, a sixteenth of a corner. Chosen."""
SAME_FIX_S = 1e-3
"""Fixes no further apart are one that stands twice: no receiver tells more than a hundred a
second."""
MOST_ACCELERATION = STANDARD_GRAVITY
"""What tyres hold, m/s^2: a friction of one."""
LED_S = 60.0
"""So long a jump of velocity is followed, the second of ``STRETCHES_S``: a bias of 0.05 m/s^2 makes
3 m/s in it."""
CHANGE_S = 2.0
"""Changes of course and speed are taken over so long: a bend or a stop, and longer than delays."""
LAG_STEP_S = 0.1
"""Lags are tried in steps of this, a small part of ``CHANGE_S``."""
USUAL_CHANGES = (1.0, 99.0)
"""Percentiles beyond which changes count as these where a lag is looked for. Chosen: bends of a
drive are more than a hundredth of it."""
SLOPE_ROUNDS = 3
"""Chosen: weights settle in two or three rounds."""
SLOPE_CORRELATION = 0.5
"""Below it the receiver shows too little of what the IMU feels to say by how much."""
SLOPE_OFF = 0.25
"""A slope further from one, beyond its own sigma, is none of an IMU's scale errors. Chosen: the
receiver's low-pass takes a tenth off quick changes."""
LAG_SIGMAS = 3.0
"""A lag counts where chance does not make it: once in four hundred drives."""
GAP_STEPS = 2.5
"""Across so many steps of the fixes no velocity is taken for the one between: two are missing."""
ALTERNATION_FIXES, ALTERNATION_BESIDE = 20, 4
"""Positions that alternate are looked for in so many fixes at a time, beside
the power at so many rates next to half of theirs, down to three tenths."""
OFFSET_INSTANTS = 16
"""So many instants are tried for an offset that begins within a drive, spread over it, and as many
at which positions jump most. Chosen: minutes of a usual drive."""
DRIFT_WAVE_S, DRIFT_WINDOW_S = 120.0, 600.0
"""Errors of minutes are waves of two time constants of a receiver's slow error and longer, which it
has less of than of shorter ones; in windows of five such, as levels are refined on."""
DRIFT_PROBABILITY = 1.0 / 14.0
"""A piece of five minutes errs for minutes by more than stated so often: of twelve of two recorded
phones none is known to (nine were looked at), and the next does by Laplace's rule of succession."""
DRIFT_TIMES_S = (30.0, 60.0, 120.0, 240.0)
"""Time constants of such errors: from what a wave of ``DRIFT_WAVE_S`` shows to what windows do."""
DRIFT_SIZES, DRIFT_STEPS = (0.5, 16.0), 20
"""Their sizes in that of the slow error that is stated, to a step of a fifth: from what it hides to
what levels are tried to."""
DRIFT_BESIDE = 4
"""Beside them are waves up to so many times as quick, of half a minute and longer: three times as
many, which tell the size of the noise to an eighth, and yet slow, as what adds up on the way."""
DRIFT_NOISES = 1.0 / 8.0, 8.0, 25
"""Factors on that size, to a step of 1.2, which with forty amplitudes are known to 1.12; to one and
a half ``LEVEL_SPREAD``."""
PATH_ACCELERATION = 0.3
"""Of what roads make, a fix's way from an IMU's path does: velocities that the path has followed
are not asked again (by 0.3 m/s in a second and 2 m/s in a minute it goes where they do), and what
lies between two fixes, 0.1 m, is below what they err by."""
DRIFT_MEAN = 2.0
"""What grows from nothing as a random walk has a mean square of its mean over a drive, T/3, that is
so many times the variance about the mean, T/6; no innovation shows the mean."""
MEASURED_SCALE, OTHER_SCALE = 5e-4, 0.05
"""Velocities of recorded phones are too long and turned by so much (3 and 8e-4 too short, 3e-4 and
4e-4 rad, by the way of half an hour each); one receiver in twenty, chosen, is of another kind."""
CLIMB_WAY_M = 200.0
"""Heights are compared with the climb over so much road: a hill's length, some ten seconds."""
LEAST_HEIGHT_SD_M = 0.1
"""Heights are told to a decimetre (GGA)."""
SQUAT = 0.0025
"""s^2/m, half of the 0.005 rad that a body pitches by for 1 m/s^2 (3 deg for 1 g, as soft cars do):
on its way to a speed it seems to climb by so many times the square of it. Pressure in a car at 30
m/s falls by a third of the stagnation pressure at most: 0.015."""
KNOWN_CLIMB_SD = 0.3
"""A slope less sure than this tells no unit from another: feet are 3.28 metres."""
LEAST_CLIMBS = 7
"""Edges of so many windows leave four degrees of freedom: with fewer Student's distribution doubts
nothing that is less than forty of its sigmas off."""
HEIGHT_UNITS = (
    (1.0 / 0.3048, ", as feet where metres belong"),
    (0.3048, ", as if they were in feet"),
)
"""How many times metres are told, and what that is."""
BEND_S, BEND_STEP_S = 0.5, 0.05
"""Bends are felt for a second and longer; a delay is told to such a step."""
ROAD_FORCE_S = 1.0
"""What slopes of a road across and its waves push is another after so long."""
TRIADS_APART_S = 0.15
"""Gyro and accelerometer of one case are read within milliseconds, but the slip of tyres, the lean
of a body and an IMU ahead of the axle set what they feel of bends apart: by up to so much in
recorded cars."""
LEAN_S = 60.0
"""A road leans or climbs all the same for no longer than this where it does so most."""
ASKEW_PROBABILITY = 2.7e-3
"""A drive of a right mounting leans so much in its mean so rarely: three sigmas of roads."""
UNIT_ODDS = 1000.0
"""Heights in metres seem to be in feet, or the other way round, with such odds in less than one
drive of a thousand (Markov's inequality)."""
MOST_LEAN, MOST_CLIMB = 0.2, 0.35
"""Roads fall to the side by 12 % at most in a bend (AASHTO, A Policy on Geometric Design of
Highways and Streets), the steepest climb by 35 %; a body leans by some degrees besides, rad."""
ARM_OFF_M = 0.5
"""Chosen: an arm that is off by less moves the path by less than most receivers err."""
SMALLEST_SHARE = 1.0 / 16.0
"""Positions that scatter by less of what they state are not as they state: two sigmas of
``LEVEL_SPREAD``. Those of one recorded phone scatter by a third of it about their path."""
