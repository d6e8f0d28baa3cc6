"""AutoMap: from a recorded drive to a road-sign map.

The library. It holds no command line and no progress bars; only ``automap.io`` and
``automap.export`` touch files. Conventions, everywhere:

- Body axes are the vehicle's: forward, right, down (FRD), origin at the IMU.
- The navigation frame is local north, east, down (NED) on the WGS-84 ellipsoid.
- ``C_a_b`` is the matrix that takes components in ``b`` to components in ``a``;
  ``C_n_b`` is the attitude, body to navigation. Quaternions are scalar-first.
- SI units and radians inside; degrees only in files, with the unit in the name.
- An accelerometer measures specific force: at rest and level it reads (0, 0, -g).
- Error parameters are errors of the reading: reading = true + sum theta phi(true).
- ``t_ns`` is int64 nanoseconds of the host clock; ``gps_s`` is float64 seconds since
  1980-01-06 without leap seconds.
"""

__version__ = "0.1.0"
