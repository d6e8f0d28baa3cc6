"""The numbers that decide where signs are put and whether, and why each is what it is.

What a user may want to change is in ``rules``. "Chosen" says of a number that neither a
derivation nor a measurement gives it, and what it weighs.
"""

from __future__ import annotations

import math

from automap.gates import gate
from automap.mapping.limits import LASTING_ERROR as LASTING_ERROR
from automap.mapping.limits import NODE_S as NODE_S
from automap.mapping.limits import POST_REACH_M as POST_REACH_M
from automap.mapping.limits import RATE_SPREAD as RATE_SPREAD
from automap.mapping.limits import SEEN_FROM_M as SEEN_FROM_M

# a sign and its views

MIN_FORWARD_M = 1.0
"""A sign nearer to the image plane than this cannot be seen as a box."""
SAME_PLACE_M = 0.25
"""Cameras nearer to one another than this see the same picture."""
VELOCITY_ERROR_S = 5.0
"""For how long an error of the trajectory's velocity stays about the same. Chosen: somewhat longer
than receivers err in a row, one to three seconds."""
STAMP_SD_S = 0.005
"""What the stamps of the frames of one pass are off by in common, beyond the camera's offset.
Chosen: a sixth of a frame at 30 a second."""
LEAST_WITHOUT_MARGIN = 0.3
"""Of a box's height, what a margin leaves at least. Chosen: a small box with a wide margin still
has a height."""
LEAST_SCORE = 1e-3
"""A box without a score still says a little of its class."""

# tracks

LINK_GATE = gate(1.7e-4, 3)
"""Squared sigmas of the three components of a box from which on it is not of a track; of one that
is it has more with that probability."""
LINK_SLACK_RAD = 0.003
"""What a box's expected direction may be off by beyond its covariance: mounting, attitude."""
LINK_OTHER = 6.0
"""Squared sigmas that another class, or another track number of the detector, costs, and that an
equal number gains. Chosen: one in 20, exp(-6 / 2), is read, numbered or surveyed wrong."""
MISFIT_WEIGHT = 0.12
"""Cauchy weight of a direction that is 6.8 sigmas off: chance does not do that."""

# sizes of classes

USUAL_LOG_SD = 0.25
"""About a usual size: national sizes are steps of 1.2 to 1.5."""
UNSURE_LOG_SD = 0.35
"""Where the table's width says less of the height: plates are taller or wider than square."""
CLASS_SPREAD_LOG, CLASS_SPREAD_FREEDOM = 0.15, 3.0
"""Spread of the sizes of one class in a drive where few signs tell it, and how many signs outweigh
that. Chosen below a step of national sizes: most of a class have one size."""
LEAST_CLASS_SPREAD_LOG = 0.05
"""However alike they measure: boxes of one class have in common how they are drawn."""
LEAST_SIZE_GAIN = 0.5
"""Of the variance of a size, what bearings must have removed for it to tell of others."""

# scatter of boxes

USUAL_SIZE_M = 0.7
"""Height of a sign of which nothing is known: most round and triangular ones of towns are 0.6 to
0.75 m high."""
SCATTER_VIEWS = 6
"""Chosen: the unknowns of a sign and of its pass leave fewer views little to scatter by."""
SCATTER_SIGNS, MARGIN_SIGNS = 300, 60
"""No more signs are asked for the scatter and for the margins. Chosen: 1800 boxes tell the scatter
to 2 %, 60 signs the margins to 9 %; more take longer."""
STAMP_SCATTERS_S, USUAL_STAMP_SCATTER_S = (0.0025, 0.32), 0.03
"""Errors of stamps that are asked for, from what moves a sign at 10 m by less than boxes scatter at
30 m/s, to where one frame a third of a second off shows little; and a frame's time, from where the
likeliest is sought."""
OWN_VARIANCES = (1e-6, 1e3)
"""Of boxes beside it, in stated ones: beyond what any detector's are."""
STAMP_SIGNS = 60
"""No more signs are asked for it. Chosen: a thousand boxes tell it to some hundredths."""
STAMP_SCATTER_PROBABILITY = 1e-3
"""Stamps that are right are said to scatter so rarely."""
SCATTER_FREEDOM, MARGIN_FREEDOM = 20.0, 4.0
"""How many boxes, and how many signs, outweigh what the settings say of scatter and margins.
Chosen: three signs seen often, and the few signs with margins that a short drive has."""
SCATTER_LIMITS = (0.3, 3.0)
"""Of the sigmas in the settings: with 1.5 px in these, boxes drawn by hand (half a pixel) to those
of a poor detector (three pixels), and neighbours that err alike."""
MARGIN_ALIKE = 0.125
"""Of the variance of margins between signs, what the next drive finds again. Measured on drawn
video with the shipped detector, 36 signs in two drives each: margins covary by 0.24 ± 0.14 of 1.9
mrad^2 that the drives state."""
MARGIN_LIMITS = (0.15, 2.0)
"""Of the sigma of margins in the settings, 2 px; on the KITTI drives margins drawn by hand differ
by 1 to 2.5 px."""
MOST_ALIKE = 0.8
"""Correlation of neighbouring frames at most: nine boxes then count as one."""
STRAY_PROBABILITY = 4.65e-4
"""A box that is right is left out of the scatter so rarely: three and a half sigmas."""
ABSORBED = 1.5
"""Of each component of a sign's boxes, what its place, size and pass errors absorb: four unknowns
of the sign over three components, and something of the pass."""

# the camera, before boxes are linked

SURE_TURN_RAD, SURE_TIME_S = 0.002, 0.005
"""A camera whose manifest is that sure needs no start: at 20 m and 20 m/s it is 4 cm and 10 cm."""
PAIR_APART_S, PAIR_WAY_M = 1.2, 1.0
"""Boxes that may be one sign are taken in pairs of up to that time and from that way on. Chosen:
longer makes more false pairs, less way leaves the plane of a pair to the noise."""
PAIR_IDLE_S = 2.0
"""Of a car that waits boxes are taken so often. Chosen: a wait that a late camera's stamps put
elsewhere keeps some."""
PAIR_LOG_GROWTH = 0.7
"""Logarithm of how much a box grows or shrinks between the two: in 1.2 s at 15 m/s, 18 m nearer,
it doubles where the sign was 36 m away."""
FORWARD_SINE = 0.02
"""Rays nearer than this to the direction of driving, 1.1 deg, make no plane with it."""
MOST_PAIRS, START_PAIRS = 20_000, 2_500
"""So many pairs are used in all and for trying starts. Chosen: more take longer."""
LEAST_PAIRS = 30
"""Fewer pairs, most of which are false, are no evidence."""
START_STEP_S = 0.08
"""Distance of the time offsets tried first. Chosen: from start to start a corner's turn of
0.5 rad/s moves rays by 0.04 rad, the widest of the scales."""
SCALES_RAD = (0.04, 0.015, 0.006)
"""Misses that count half, from start to end: of a camera some degrees off, and then of what boxes,
pitching and the trajectory leave."""
REACH_SIGMAS, MOST_REACH_S = 3.0, 1.0
"""How far to look for a time offset, in sigmas of it before any sign was seen; and how far, s,
where pairs vote, about what the boxes of a pair are apart."""
START_PROBABILITY = 4.7e-3
"""A start of no use, four parameters in all, saves that much loss so rarely (each box counted
once)."""

# the camera, from all signs

ATTITUDE_WINDOW_S = 120.0
"""Signs seen within such a time share the trajectory's attitude error: a process with a time
constant of a minute has one independent value in two."""
CAMERA_VIEWS = 4
"""Signs with fewer views say nothing about the camera that their own unknowns do not absorb."""
SETTLED_SIGMAS = 0.02
"""A step of the camera's values that is smaller than this part of their sigmas was the last."""
MOST_SIGNS_TRIED = 30
"""The tracks of so many signs, spread over the drive, are laid over the path. Chosen: more take
longer."""
ALIKE_PROBABILITY = 2.7e-3
"""The right one of two time offsets explains the boxes that much worse so rarely, and offsets that
are nearer to one another are one: three sigmas of one coordinate."""
HELD_TIME_S = 1e-6
"""Prior of a time offset that is held: nothing against what any sign tells of it."""
BEYOND_MANIFEST_PROBABILITY = 2.7e-3
"""A right manifest is called in doubt so rarely: three of its sigmas."""
DOUBTED_TURN_RAD, DOUBTED_TIME_S = math.radians(10.0), MOST_REACH_S / REACH_SIGMAS
"""Sigmas of a camera whose stated ones its boxes contradict: three make half of a usual camera's
view, beyond which nobody mounts one that looks ahead, and as far as a time offset is looked for."""
HYPOTHESIS_PAIRS = 1200
"""So many pairs judge each hypothesis of what is wrong with a camera. Chosen: half of what starts
are tried with, since hundreds of stamps are tried."""
OTHER_SCALES = (0.5, 2.0 / 3.0, 1.5, 2.0)
"""Of a calibration: between 720, 1080 and 1440 rows, and half of each."""
MOST_SHIFT_S, MOST_RATE = 30.0, 0.25
"""How far stamps are looked for. Chosen: a wrong chapter or leap seconds, and 24 frames a second
for 30."""
MOST_STRIDE = 30
"""Frames of which a detector sees one. Chosen: one a second of a usual video."""
DOUBTED_FOCAL = 0.15
"""One sigma of a focal length whose stated one the boxes contradict: three reach from a camera's
linear mode to its wide one."""
MOST_TRIED = 2
"""Explanations of a doubted camera with which signs are located. Chosen: each takes as long as the
run without."""
MORE_BOXES, CLOSER_BOXES = 0.05, 0.8
"""Of all boxes, what an explanation beyond turn, time offset and focal length must place more, or
of their scatter, what it may leave. Chosen: of two that fit alike the plainer is kept."""
FITS_SHARE = 0.8
"""Of the boxes of a doubted camera, what a camera that explains them must place. Chosen: of clean
drives 0.9 and more are."""

# tracks against the path

LATE_S, LATE_STEP_S = 3.2, 0.04
"""How far from their stamps frames are looked for by all tracks, s, and in what steps: a car
nods at one to two hertz, so that a step is a tenth of a swing at most."""
LATE_OWN_S = 0.1
"""Offsets of no consequence about the estimated one: what a nod tells is lost beyond, a sixth of a
swing."""
PLACES = 400
"""So many times of the path tracks are laid over. Chosen: more take longer, and what one track
reaches by chance the mean of hundreds tells to a tenth."""
TRACK_BOXES = 16
"""So many boxes of a track are asked. Chosen: neighbours of more err alike, and take longer."""
COVERED_SHARE = 0.9
"""Of the tracks, what must have a path at an offset for it to compare. Chosen: what a tenth of them
says in the mean of the others is not much."""
COUNT_AS_ONE = (1.2, 2.5, 1.5)
"""Boxes of one track whose errors sideways, up and down and of height count as one's, so alike are
neighbours: of hand-drawn ones of ten recorded drives (docs/geolocation.md)."""
PASS_TURN_RAD = 0.004
"""Attitude of the path while a sign is passed: what headings of good trajectories err by, 0.2
deg."""
STATED_FOCAL_SD = 0.03
"""One sigma, as a part, that a focal length may seem to be off by and nothing is wrong. Chosen:
margins of boxes that grow with their signs look like one."""
FOCAL_SCALES = (0.5, 2.0 / 3.0, 0.8, 1.0, 1.25, 1.5, 2.0)
"""Of a focal length, from where it is estimated: to either side of each as far as ``DOUBTED_FOCAL``
reaches in a sigma and a half."""

# existence

FITTING_BOX_NATS = 3.0
"""What a further box that fits says for a sign. Chosen: that a false one fits by chance one time in
twenty; more believes false boxes, less gives up signs of few views."""
RATE_VIEWS = 5
"""Signs with so many views are real, and tell how often a sign is found."""
GROWN = 1.5
"""What a box grows by from the first on where it is driven towards: three sigmas of two heights
that err by a tenth each."""
RATE_LIMITS = (0.2, 0.95)
"""How often a detector finds a sign in view, whatever a short drive shows."""
LIKE_ASPECT_RAD = math.radians(30.0)
"""Further round a face than it was seen from, it should still be found."""
WHOLLY_IN_VIEW = 0.7
"""Of its height, how far the middle of a sign must be from the edge of the picture: half of it, and
as much again as its place is unsure."""
HIDDEN, HIDDEN_S = 0.05, 1.0
"""Of the time something is in the way of a sign, and for how long as a rule, s. Chosen: a parked
van or the crown of a tree, ten metres of a street; of 0.01 to 0.2 and of 0.25 to 4 s the likeliest
for the signs of seven recorded drives, boxed by hand, are 0.05 and 1 or 2 s."""
STRAY_FRAME = 1e-3
"""A sign that is hidden is found so rarely: a false box lies at its place, of a tenth of one a
frame in a hundredth of the picture. Chosen."""
STANDING = 0.6
"""Of boxes that show no sign, those that show what stands there: 8 of 13 with scores over 0.9 on
street images (``look_alikes.csv``)."""
THINGS_A_SIGN = 0.2
"""Things that look like signs now and then, for each sign, before a drive tells: of boxes on street
images 0.11 show no sign, of which ``STANDING`` stand; of things found at a rate q there are 1 / q
as many, of which those with one box in twelve frames or more are found: the integral is some 3."""
BOX_LIMITS = (0.2, 0.99)
"""A score is the probability that a box shows a sign within these, as those of the shipped detector
are to 0.03 (docs/detector.md); an external one may say 1 of every box."""
SCORE_CORRELATION = 0.25
"""Of the log odds of one thing's boxes, at least, whatever a drive shows: what the classifier's
views of a pass have (``vision/limits.py``, ``VIEW_CORRELATION``, measured on held-out tracks)."""
IMAGINARY = 2.0
"""Things seen once that are signs, and as many that are none, that stand for what is expected
before the drive tells. Chosen: few single boxes say little of how many are signs."""
LARGEST_FACE_M = 2.4
"""Of warnings and regulations: the largest boards of AS 1742 and the VzKat."""
SMALLEST_FACE_M, LARGEST_THING_M = 0.2, 10.0
"""Height of the least face, and of the largest thing that is taken for one. Chosen: a narrow plate,
and the front of a house of three floors."""
ODD_SIZE = 2.0 / 3.0
"""Of faces, those of any size that is made, whatever is usual for the class: on motorways and
gantries all may be."""
NO_FACE = 0.02
"""Share of what is found again and again that is larger than any face. Chosen: one in fifty, so
that a size known to a twentieth is as likely a face's at 2.6 m; with one in 200 or one in four it
is so at 2.7 and 2.4 m. On eight drives in drawn streets it was none to one in four."""

# passes

PASS_S = 30.0
"""Longer without a view of a sign is another pass: no block is driven round sooner."""
APART_PROBABILITY = 1e-3
"""A sign that is seen twice at a time, or whose far boxes place it elsewhere, is taken for two so
rarely."""
TWICE_REACH_M = 3.0
"""Two tracks of one sign are placed no further apart, unless what they are off on their own allows
more. Chosen: a sign is seen to half a metre or so, and posts are no nearer than half of that."""
FACE_SD_M = 0.1
"""Places of one sign agree to no better than this: the extent of its face."""

# the trajectory, adjusted

LEAST_ADJUSTMENT = 0.02
"""Of the trajectory's sigma, what signs must remove somewhere. Chosen: less is no adjustment worth
a file of its own."""

# control signs

CONTROL_REACH_M = 15.0
"""A surveyed sign further from every located one was not seen. Chosen: more than trajectories that
state some metres are off."""
MISSED_PROBABILITY = 1e-3
"""A surveyed sign that was seen is taken for another so rarely."""
CONTROL_RIVAL = 6.0
"""Squared sigmas by which a neighbour must fit less for a surveyed sign to count. Chosen: it is
taken for the neighbour one time in 20, exp(-6 / 2), and left out rather."""
LEAST_CONTROL_SD_M = 0.01
"""Of a surveyed place, whatever it states: a face has no better one."""

# which way faces look

TURNED_SD, FACE_ELSEWHERE = math.radians(10.0), 0.05
"""Of faces about the direction against the traffic, and the share that is for another road, before
a drive's own signs tell. Chosen: signs are set up by eye, some turned 3 to 5 deg away so that
headlights do not dazzle, and posts twist."""
BESIDE_SD_M = 6.0
"""How far to the side of a car the signs for its road stand: two sigmas are the far verge of a road
four lanes wide."""
FACE_ASPECT_SD, PLATE_ASPECT_SD = 0.03, 0.35
"""Of the logarithm of width over height, from sign to sign: a face of known shape as boxes are
drawn about it, chosen as a pixel of thirty; a plate, square to twice as wide or tall."""
FACE_ALIKE = 0.02
"""Of width over height, what a sign's boxes of about one size err by in common beside their
margins, before a drive tells. Chosen: a pixel of fifty."""
FACES_FREEDOM = 4.0
"""How many signs outweigh what is stated above. Chosen: few tell of it."""
FOUND_ANYWAY = 0.05
"""Of boxes that should be too narrow to be found, those that are: chosen, for two sigmas off a
scatter is no longer normal."""
THINNEST = 0.02
"""A face seen edge on is still as wide as that part of its height: plates have an edge."""
FACE_READ_SD = math.radians(40.0)
"""Of a face's normal about where it was looked at from, where nothing else is known: faces are
read up to some 70 deg off, each as likely."""

# what a sign of the map is called

WEAK_DEPTH_LOG_SD = 0.25
"""A sign whose distance is less sure than that part of it is flagged: no better than by a usual
size alone (``USUAL_LOG_SD``)."""
VIEW_EVIDENCE = 0.5
"""A box of score one is right with that. Chosen: one box alone never makes a sign sure."""
CONFIDENCE_SD_M = 3.0
"""Chosen: where bearings alone are known, a place that is unsure by this lowers the confidence by
1 / sqrt(2)."""
FAR_M = 60.0
"""A sign that was never nearer is flagged. Chosen, as ``max_single_view_m``."""
SIZE_LIMITS_M, HEIGHT_LIMITS_M = (0.15, 6.0), (-2.0, 15.0)
"""Of what may be a sign, heights above the road. Chosen: no face is so small or so large, and
signs stand at the foot of a bank or hang from a gantry, none lower or higher."""
IMPLAUSIBLE_CONFIDENCE = 0.3
"""Factor on the confidence of what is too large, too small or in no place for a sign. Chosen: below
the usual thresholds, and still on the map."""
AFTER_S = 15.0
"""So long after its last view at most a sign is passed: 60 m at 15 km/h."""
OVERHEAD_HEIGHT_M, OVERHEAD_LATERAL_M = 4.5, 5.0
"""A sign above this, and no further to the side, hangs over the road: what is kept free for
lorries, and a lane and a half."""

# carriers

CARRIER_PROBABILITY = 1e-9
"""Chance, by the gate, of boxes that fit a thing that moves along so much better than one that
stands. Where only the size tells the two apart, it is one eleven times as large as signs usually
are. Chosen: what is left out of the map must be sure, and gantries are four times as large."""
FAR_PROBABILITY = 1e-3
"""The same of what is followed for more than ``SEEN_FROM_M``: of that about every other one is
carried, and a sign in a thousand may be lost by it."""
FOCAL_STEP = 0.1
"""Between two focal lengths, as a part, by which boxes are tried. By one that is half of it off
signs that are followed round bends of 150 to 600 m radius still stand; by one that is all of it off
each of them moves along."""
CARRIER_CLOSING = (-0.3, -0.2, -0.1, -0.05, 0.0, 0.05, 0.1, 0.2, 0.3)
"""Parts of its own way by which a camera comes nearer to a carrier. With more it is overtaken
within some 100 m, and looks like a sign that is half as large again."""
CARRIER_VIEWS = 4
"""Fewer boxes, twelve measurements of five unknowns, tell no motion."""
NEXT_SMALLER = 1.5
"""A box so many times smaller than the one before in its track, of which it covers nothing, is of
the next sign. Chosen: boxes of one thing err by a tenth, and a sign that passes is seen three times
as large as the next one."""
FIXED_PROBABILITY = 1e-3
"""Of a box of a thing that stays to lie further from its place. Chosen: such boxes are many."""
FIXED_MISSED = 8
"""Frames with boxes in a row without a thing's: of one that every other frame finds, one time in
256."""
FIXED_VIEWS = 8
"""Frames that show such a thing at least. Signs that are seen once each are at one place of the
picture by chance: eight of sixteen, where each is with one in 20, three times in ten million."""
FIXED_ALONE = 3
"""A thing that stays is in so many times more frames than boxes of some twice its height. A sign
has these for a third of the way to it; where it keeps its bearing, outside of a bend, it fills one
place of the picture for some two thirds of the way at most."""

# finished sightings

LEAST_CROSSING = math.radians(3.0)
"""Rays that cross at less make no candidate: with 2 deg of bearing their crossing is anywhere."""
NEAREST_OBJECT_M = 0.5
"""No object is nearer to a camera: it would be in the car."""
SAME_CANDIDATE_M = 0.5
"""Crossings in one square of this size lead to the same object."""
SCALE_SETTLED_M = 0.2
"""Depths that move by less, near (6 m) and far (15 m), have settled: a fifth of what cameras are
off by."""
LEAST_DEPTHS = 10
"""Ten depths of a log sd of 0.3 tell a factor to a third of its prior; fewer tell too little."""
GOOD_CROSSING = 0.5
"""Sigma of a distance by crossing bearings, part of it, beyond which it says nothing of depths."""
SHARED_CAMERA_VARIANCE = 0.5
"""Of the variance of the cameras' positions, what all cameras of one street share. Chosen: half."""
WEAK_SD_M = 5.0
"""An object less sure than this in its worst direction is flagged: about the width of a street."""

IMU_ABOVE_ROAD_M, IMU_ABOVE_ROAD_SD_M = 1.0, 0.4
"""Of an IMU of which nobody says where it is: from a car's floor, 0.3 m, to its roof, 1.7 m, each
as likely (the sigma of that is 0.4)."""


# condition

CONTRAST_VIEWS = 3
"""Fewer views of a face tell no scatter of its contrast: two have one difference."""

# boxes and path at odds

USUAL_WEAK, MISFIT_PROBABILITY = 0.05, 1e-6
"""Part of a right drive's signs that is placed uncertainly: of 87 on ten recorded drives none was,
which leaves 3.4 % (95 % limit). What chance makes of that so rarely is told."""
LOST_SHARE, LEAST_LOST = 0.5, 100
"""Of a hundred boxes or more half are left out where the video is of another place. Chosen: of
right recordings one in a hundred is."""
