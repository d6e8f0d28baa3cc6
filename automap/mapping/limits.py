"""The numbers that decide a merged map, and why each is what it is.

"Chosen" says of a number that neither a derivation nor a measurement gives it, and what it weighs.
Evidence is in nats: three of them are odds of 20 to 1.
"""

from __future__ import annotations

import math

from automap.gates import gate_in_plane

# the errors of paths

PATH_CORRELATION_S = 60.0
"""Time constant of what wanders of the trajectory's position error (satellite errors do so for
minutes)."""
LASTING_ERROR = 0.5
"""Part of the variance of the trajectory's position error that outlasts the drive, where the data
do not tell another. Any part is as likely as another: horizontally it is 0.56 and 0.26
in the two phones of ``configs/receivers``, whose slow wander outlasts passes."""
NODE_S = 10.0
"""Nodes of what wanders of a path's error: between them the inertial sensors hold its shape. Of
simulated drives of two towns with four kinds of receivers such errors are likelier by 7 nats than
those that change from sign to sign; with 30 s by 13, but then their places are no better."""

# which sightings are one sign

SEEN_FROM_M = 80.0
"""From further off no camera reads a sign: who has driven that far has
passed all that was in sight at first."""
ROUNDS, SETTLED_SHARE = 3, 0.01
"""How often every drive is looked at again at most, with the map of all others known, and of how
many signs the sightings change in the last turn. Chosen: each turn changes a fifth to a tenth of
what the one before did."""
SAME_GATE = gate_in_plane(math.exp(-8.0))
"""Squared sigmas by which a sign lies further from itself, in another drive or an older map, with
the probability of four sigmas in the plane."""
MOST = 8
"""Candidates kept per sighting, the likeliest. Chosen: more signs than that do not stand where one
drive may be off."""
SLACK_M = 0.15
"""What places of one sign may differ by beyond the stated errors: frames of reference that
the drives do not share perfectly, the extent of the face."""
NEW_PER_M2, NEW_PER_M = 2e-3, 0.3
"""Density of signs that the map does not hold yet, round a place that has signs: one on 500 m^2,
and spread over some three metres of height."""
FACING_SD, FACING_LIMIT = 0.45, 1.75
"""Of the direction a face looks as two drives see it, rad: cameras pass within some 25 deg of its
axis. Faces further from one another than 100 deg are two: the other face of a sign is another."""
LEAST_CONFIDENCE = 0.05
"""What a sighting's class counts at least, however unsure the sighting."""
HALO_M = 400.0
"""Round a cell, what is looked at with it. A drive's offset, from signs every 40 m that are seen to
half a metre, forgets what is further off than some 100 m; four times that leaves a fiftieth."""

DETECTION = 0.8
"""How often a drive sees a sign, before that is estimated: near the mean of ``RATE_PRIOR``."""

# evidence of two classes

SAME = 2.0
"""Evidence in nats that two sightings of one class are one sign, before any position. Chosen: of
neighbouring signs one in seven is of the same class."""
SAME_GROUP, UNKNOWN_FACE = -1.0, 0.0
"""Of faces of one colour and shape, which are mistaken for one another, and where one was not read.
Chosen."""
DIFFERENT = -6.0
"""Of faces that look otherwise. Chosen: a class is read that wrong one time in 400."""

# the offset of a drive

STRETCH_S, STRETCH_SIGHTINGS = 40.0, 24
"""An offset is sought for so much of a drive at a time: less than the time constant of a
trajectory's error, over which it stays about the same; and at most so many sightings, which decide
it by vote."""
LEAST_OFFSET_VARIANCE = 1e-4
"""Of a drive's offset, m^2: a centimetre, where a trajectory states none."""
STRAY_PROBABILITY = math.exp(-4.5)
"""A sighting that is right counts less so rarely: three sigmas in the plane."""
STRAY_GATE = gate_in_plane(STRAY_PROBABILITY)
"""The squared sigmas that go with it; on a single axis chance exceeds them at a quarter of the
time."""
STRAY_MEMBERS = 3
"""Sightings of a sign from which one may be called stray: of two nobody knows which."""

# how large the errors are

LEVEL_LOG_SD = 0.3
"""How far the stated errors are trusted: one sigma of the logarithm of their factors. Chosen: to a
third."""
LEVEL_STEPS = (0.03, 0.07, 0.02)
"""Of the logarithms of what wanders, what lasts and what is a sighting's own, to which the common
levels are rounded, so that they stay, and with them all that was placed, where some more drives
tell them anew. Two standard errors, or little more than one of what lasts, by the curvature of the
restricted likelihood of 24 tiles of 100 simulated drives of a town: rounding adds at most 0.6 of
one."""
DRIVE_LEVEL_STEP = 0.1
"""Of the logarithms of a drive's own levels, to which they are rounded for the same reason: a third
of ``LEVEL_LOG_SD``, the sigma of what a drive of few signs tells; rounding adds a tenth of one."""
COMMON_SD_M = 0.05
"""What no number of passes averages away: the frame of satellite positioning, the centre of
a face as a box shows it."""
UNKNOWN_SD_M = 3.0
"""Taken for the error of a sighting whose covariance is not known. Chosen: that of a receiver
alone."""
LEAST_SD_M, LEAST_OWN_SHARE = 0.02, 0.02
"""Own error of a sighting at least, m, and part of its variance: so that what is shared never takes
all of it."""
CORE_SIGNS, MOST_SIGNS, MARGIN_M = 50, 140, 60.0
"""Signs of a tile, those with its margin, and the margin. Chosen: a drive passes 60 m in a tenth of
the time constant of its error at 10 m/s; larger tiles take longer by the cube."""

# whether signs are there

LEAST_EXISTENCE = 0.5
"""A map sign less likely than this to be there is left out of the map."""
CHANGE_PER_YEAR, LEAST_CHANGE = 0.03, 0.002
"""Rate at which a sign is taken down, and at which one is put up where none was. Chosen: signs last
some thirty years. Probability of that between any two drives at least, however close in time."""
RATE_SPREAD = 6.0
"""Sum of the beta parameters of a sign's own rate of being found, in frames as by drives. Chosen:
rates of 0.85 differ by 0.13 between signs."""
RATE_PRIOR, REAL_PRIOR = (8.0, 1.5), (9.0, 1.0)
"""Beta parameters of how often a real sign in view is seen, and of which share of map signs are
real. Chosen: no more than ten drives or signs tell."""
SPREAD, SPREAD_LOG_SD = RATE_SPREAD, 1.0
"""Sum of the beta parameters of a real sign's detection rate, how alike signs are, where the data
do not tell, as within a drive; and the sigma of its logarithm."""
SPREADS = (2.0, 3.0, 4.5, 6.0, 9.0, 13.0, 20.0, 40.0)
"""Those that are tried, each half as large again as the last; at the largest all are alike."""
FALSE_BETA = (1.0, 20.0)
"""Beta parameters of the rate at which other drives see what is no sign. Chosen: one time in 20."""
LASTING = 0.3
"""Of things that are no signs and that a drive saw, those that every drive takes for one alike: the
correlation of two drives' mistakes. However many drives see a thing, it is so many times, 1 / 0.3,
likelier by that. Of 13 boxes without a sign and with scores over 0.9 on street images eight show
what stands there for the next drive too (``look_alikes.csv``); half of those, as with classes
(``sureness.COMMON``), is light and distance, which differ."""
STRAY = 0.02
"""Rate of sightings where a sign once was."""
OLDER_BELIEF = 0.95
"""Of a sign on an older map, before any drive passes it again, at most."""
DRIVE_FREEDOM = 20.0
"""Signs that outweigh the overall rate in that of a drive. Chosen: a short drive with some misses
is no blind one."""
OVERALL_LIMITS, DRIVE_LIMITS = (0.2, 0.97), (0.02, 0.98)
"""Of detection rates: neither one miss nor one sighting decides a sign by itself."""
TELLING_DRIVES = 3
"""Drives that must have had a sign in view for it to tell of rates: that one of them saw it is why
it is known at all."""

# what was in view

NEAREST_M, FARTHEST_M = 7.0, 60.0
"""Between these distances a sign may be seen; how often it is, is estimated. Nearer it is beside
the picture, further away some 10 px high."""
FACE_LIMIT = 1.05
"""Angle at which a face is still read, rad: 60 deg."""
EDGE_SHARE = 0.9
"""Part of half the field of view within which a sign counts as in the picture."""
LEAST_ROWS = 2
"""Places on the path, some 8 m apart, from which a sign must have been in view."""
SAME_HEADING, SAME_LATERAL_M = 0.6, 5.0
"""Two drives approach a sign alike when they differ by less, rad and m: they come along one road,
in lanes beside one another."""
HEAD_ON, HEAD_ON_M = 0.8, 12.0
"""A drive comes at a face along its own road within these, rad and m: the road may be four lanes
wide, and a face is turned to its lane."""

# class, backs and changes

CLASS_RIGHT, ALTERNATIVES = 0.93, 5
"""How often the class of a sign in one drive is right, and among how many others a wrong one
falls."""
CHANGED = 1e-3
"""Between two drives, how often a sign's face becomes another's. Chosen: as often as signs change
in a fortnight (``CHANGE_PER_YEAR``)."""
BACK_PROBABILITY = 3e-3
"""A back that belongs to a sign is taken for one of its own so rarely."""
AWAY_COSINE = -0.5
"""Faces further turned from one another than 120 deg look the other way."""
THICKNESS_M = 0.2
"""Face and back of a sign, and the middles of boxes about them, are no further apart."""
BACK_REACH_M = 5.0
"""Backs lie no further from their faces, whatever the sigmas. Chosen: less misses backs where a
trajectory wandered, more takes a grey face across the road for the back."""
POST_REACH_M = 0.5
"""Signs on one post are no further apart in plan than half a face."""
POST_LIMIT_M = 1.2
"""Whatever their uncertainty: posts stand 1.5 m apart and more."""
GANTRY_REACH_M = 12.0
"""Neighbours over the road share a gantry up to that distance, three lanes. Chosen: gantries stand
further apart along the road."""
SAME_PLACE_M, MAP_SLACK_M = 6.0, 0.2
"""Signs of two maps further apart are two; and what maps are off by against one another beyond
their covariances. Chosen."""
MOVED_M = 20.0
"""A sign put up again within that distance has moved. Chosen: to the other side of a crossing."""
GONE_BELOW = 0.2
"""A sign is called gone when the belief that it still stands is below this. Chosen: more lists
signs as gone that stand, less leaves out some that went."""
