"""GPS/INS fusion: an error-state Kalman filter on the local NED frame, and its smoother.

Reading order: ``model`` (states, priors, noise), ``mechanisation`` (the strapdown step),
``kernels`` (forward filter, Bryson-Frazier smoother, dense output), ``measurements`` (what
is observed at each node), ``standstill``, ``alignment`` (attitude at the start),
``mounting`` (unknown axes), ``engine`` (the passes put together), ``gnss_only``.
"""
