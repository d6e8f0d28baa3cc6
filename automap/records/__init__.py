"""What passes between modules: small frozen records of plain arrays.

Shapes are given as ``[n]`` and ``[n, 3]``; all floats are float64. A value that the
source did not give is NaN. Nothing here knows about files.
"""

from __future__ import annotations

from automap.records.arrays import NO_TIME, BoolArray, FloatArray, Image, IntArray
from automap.records.clocks import ClockModel, DriveClocks, ReceiverFilter
from automap.records.motion import DrivePath, Trajectory, along_course
from automap.records.pictures import (
    DISTORTION_SD,
    FARTHEST_ARM_M,
    LEVER_ARM_SD_M,
    TRACK_PROBABILITIES,
    UNKNOWN_DISTORTION_SD,
    UNKNOWN_FOCAL_SD,
    Camera,
    Crop,
    Detections,
    FrameTimes,
    Looked,
    PictureTurns,
    VideoFrame,
    usual_matrix,
)
from automap.records.sensors import (
    FixErrors,
    Fixes,
    FixType,
    ImuCalibration,
    ImuData,
    RawImu,
    TriadCalibration,
    WheelSpeed,
)
from automap.records.signs import (
    Bearings,
    PlacedSign,
    ReviewAction,
    ReviewKind,
    RoadPosition,
    Roads,
    SeenIn,
    Sign,
    SignPoints,
)

__all__ = [
    "DISTORTION_SD",
    "FARTHEST_ARM_M",
    "LEVER_ARM_SD_M",
    "NO_TIME",
    "TRACK_PROBABILITIES",
    "UNKNOWN_DISTORTION_SD",
    "UNKNOWN_FOCAL_SD",
    "Bearings",
    "BoolArray",
    "Camera",
    "ClockModel",
    "Crop",
    "Detections",
    "DriveClocks",
    "DrivePath",
    "FixErrors",
    "FixType",
    "Fixes",
    "FloatArray",
    "FrameTimes",
    "Image",
    "ImuCalibration",
    "ImuData",
    "IntArray",
    "Looked",
    "PictureTurns",
    "PlacedSign",
    "RawImu",
    "ReceiverFilter",
    "ReviewAction",
    "ReviewKind",
    "RoadPosition",
    "Roads",
    "SeenIn",
    "Sign",
    "SignPoints",
    "Trajectory",
    "TriadCalibration",
    "VideoFrame",
    "WheelSpeed",
    "along_course",
    "usual_matrix",
]
