"""The quantities of a scenario with the values that they may have, and why.

Beyond them a value is a slip of the unit or of the exponent, or a drive that takes days to write.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from pydantic import AfterValidator, Field

from automap.records import FARTHEST_ARM_M


def _in_utc(time: datetime) -> datetime:
    """A time without a zone as what its key says, not as one of this machine's zone."""
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time


def _in_gps_time(time: datetime) -> datetime:
    # receivers count from 1980 on; 2099 is the last year that RMC's two digits tell
    if not 1980 < time.year < 2100:
        raise ValueError(f"no receiver tells the year {time.year}; give one from 1981 to 2099")
    return time


Utc = Annotated[datetime, AfterValidator(_in_utc), AfterValidator(_in_gps_time)]

# a place that roads, rails or water lead to: the shore of the Dead Sea lies at -440 m, Everest at
# 8849 m; local axes at the poles have no east
Height = Annotated[float, Field(ge=-500, le=9000)]
Latitude = Annotated[float, Field(ge=-89, le=89)]
Longitude = Annotated[float, Field(ge=-180, le=180)]

# a route: a step every 5 cm makes 400 km 64 MB a curve; a hundred turns; a robot turns on the spot,
# a motorway's widest bend has 20 km; trains do 160 m/s; spirals of motorways are 300 m long
Length = Annotated[float, Field(ge=0, le=400e3)]
Turn = Annotated[float, Field(ge=-36e3, le=36e3)]
Radius = Annotated[float, Field(ge=0.1, le=1e6)]
Slope = Annotated[float, Field(gt=-30, lt=30)]
Speed = Annotated[float, Field(ge=0.05, le=160)]
Transition = Annotated[float, Field(gt=0, le=1000)]
LongTime = Annotated[float, Field(ge=0, le=86400)]
Hold = Annotated[float, Field(gt=0, le=86400)]
"""A stop, a stay, what is played back: a day."""
LastingTime = Annotated[float, Field(gt=0, le=1e9)]
"""A time constant; what hardly changes has a long one."""

# a vehicle: racing cars accelerate by 5 g; an arm as the manifest has it
Acceleration = Annotated[float, Field(gt=0, le=50)]
Angle = Annotated[float, Field(ge=-360, le=360)]
SmallAngle = Annotated[float, Field(ge=-10, le=10)]
Roughness = Annotated[float, Field(ge=0, le=10)]
AngleSd = Annotated[float, Field(gt=0, le=180)]
ImuHeight = Annotated[float, Field(gt=0, le=10)]
_Arm = Annotated[float, Field(ge=-FARTHEST_ARM_M, le=FARTHEST_ARM_M)]
Arm = tuple[_Arm, _Arm, _Arm]
ArmSd = Annotated[float, Field(ge=0, le=FARTHEST_ARM_M)]
Angles = tuple[Angle, Angle, Angle]

# clocks: crystals are off by 100 ppm at the most; what is late by more than a minute is lost
DriftPpm = Annotated[float, Field(ge=-1000, le=1000)]
Delay = Annotated[float, Field(ge=0, le=60)]
DelaySd = Annotated[float, Field(gt=0, le=60)]

# sampling by data sheets: the fastest MEMS sensors 8 kHz, receivers 100 Hz, cameras of motion
# 1 kHz; trackers that save their battery have a fix a minute
ImuRate = Annotated[float, Field(ge=1, le=10e3)]
FixRate = Annotated[float, Field(ge=0.01, le=100)]
FrameRate = Annotated[float, Field(ge=0.1, le=1000)]

# noise by data sheets: the poorest gyros 0.1 deg/s/sqrt(Hz) and accelerometers 1 mg/sqrt(Hz); a
# hundred times that drowns any drive
GyroNoise = Annotated[float, Field(ge=0, le=0.2)]
AccelNoise = Annotated[float, Field(ge=0, le=1)]
Celsius = Annotated[float, Field(ge=-90, le=150)]
Kelvin = Annotated[float, Field(ge=-150, le=150)]

# receivers err by kilometres at most, where one cell tower is all they have
_Metres = Annotated[float, Field(ge=0, le=10e3)]
_StatedMetres = Annotated[float, Field(gt=0, le=10e3)]
_Velocity = Annotated[float, Field(ge=0, le=100)]
_StatedVelocity = Annotated[float, Field(gt=0, le=100)]
PositionSd = tuple[_Metres, _Metres, _Metres]
StatedSd = tuple[_StatedMetres, _StatedMetres, _StatedMetres]
VelocitySd = tuple[_Velocity, _Velocity, _Velocity]
StatedVelocitySd = tuple[_StatedVelocity, _StatedVelocity, _StatedVelocity]
Geoid = Annotated[float, Field(ge=-110, le=90)]
"""EGM2008 lies between -107 and 86 m."""
SpeedNoise = Annotated[float, Field(ge=0, le=100)]
Share = Annotated[float, Field(ge=0, le=1)]
Weight = Annotated[float, Field(ge=0, le=1e9)]

# pictures: a lens of a degree on the largest picture; grey values end at 255
Pixels = Annotated[int, Field(ge=64, le=4096)]
Focal = Annotated[float, Field(ge=10, le=250e3)]
GreyNoise = Annotated[float, Field(ge=0, le=255)]
Blur = Annotated[float, Field(ge=0, le=100)]
BoxSd = Annotated[float, Field(gt=0, le=100)]
Quality = Annotated[int, Field(ge=0, le=51)]
Brightness = Annotated[float, Field(gt=0, le=100)]

# signs: gantries are 10 m high, the largest boards as wide; what stands 100 m aside is of another
# road
SignHeight = Annotated[float, Field(gt=0, le=20)]
SignSize = Annotated[float, Field(ge=0.05, le=20)]
Aside = Annotated[float, Field(ge=-100, le=100)]
Turned = Annotated[float, Field(ge=-75, le=75)]
RoadWidth = Annotated[float, Field(gt=0, le=100)]
Country = Annotated[str, Field(pattern="^[A-Za-z]{2}$")]
"""ISO 3166: the manifest has it so."""
