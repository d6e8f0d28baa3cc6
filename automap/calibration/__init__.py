"""Calibration of an inertial sensor on a desk: static, dynamic, and its noise (Allan).

The method is that of A. Amirsadri, J. Kim, L. Petersson and J. Trumpf, "Practical
Considerations in Precise Calibration of a Low-cost MEMS IMU for Road-Mapping Applications";
equation numbers in this package are theirs. All of it works in the sensor's own axes and on
the readings as they were logged, counts or units.
"""
