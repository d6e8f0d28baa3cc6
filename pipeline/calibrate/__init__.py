"""``automap calibrate``: the parameters of a sensor from a log of it."""
