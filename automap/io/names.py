"""The one place that knows what the files of a run are called."""

from __future__ import annotations

# intermediate products, read by later stages
IMU = "imu.parquet"
FIXES = "fixes.parquet"
ODOMETER = "odometer.parquet"
INGEST = "ingest.json"
SYNC = "sync.json"
SYNC_DELAYS = "sync_delays.parquet"
FUSION = "fusion.json"
TUNED = "tuned.toml"
DETECTIONS = "detections.parquet"
CROPS = "crops.parquet"
SEARCHED = "searched.parquet"
CAMERA_TURNS = "camera_turns.json"
SIGNS_RAW = "signs_raw.parquet"

# results, named in the documentation
TRAJECTORY = "trajectory.parquet"
TRAJECTORY_FILTER = "trajectory_filter.parquet"
TRAJECTORY_ADJUSTED = "trajectory_adjusted.parquet"
IMU_ERRORS = "imu_errors.parquet"
INNOVATIONS = "innovations.parquet"
SIGNS_GEOJSON = "signs.geojson"
SIGNS_TABLE = "signs.parquet"
OBSERVATIONS = "observations.parquet"
CONTACT_SHEET = "detections.jpg"
KML = "map.kml"
KMZ = "map.kmz"
GPKG = "map.gpkg"
DICTIONARY = "data_dictionary.csv"
PICTURES = "pictures/"
PICTURE_INDEX = "pictures/index.csv"
REPORT = "report.html"
SIGN_ROADS = "sign_roads.csv"
RUN = "run.json"
REVIEW = "review.json"
REJECTED = "signs_rejected.geojson"
EVALUATION = "evaluation.json"
MERGE = "merge.json"

RUN_FILES = frozenset(
    {
        *(IMU, FIXES, ODOMETER, INGEST, SYNC, SYNC_DELAYS, FUSION, TUNED, DETECTIONS, CROPS),
        *(
            SEARCHED,
            CAMERA_TURNS,
            SIGNS_RAW,
            TRAJECTORY,
            TRAJECTORY_FILTER,
            TRAJECTORY_ADJUSTED,
            IMU_ERRORS,
            INNOVATIONS,
        ),
        *(SIGNS_GEOJSON, SIGNS_TABLE, OBSERVATIONS, CONTACT_SHEET, KML, KMZ, GPKG, DICTIONARY),
        *(REPORT, RUN, REVIEW, REJECTED, EVALUATION, MERGE),
    }
)
"""What a run or a merge keeps in OUT under a name of its own."""

DEFAULT_OUT = "_automap"
MANIFEST = "drive.toml"
IMU_TABLE = "imu.csv"
TRUTH_DIR = "truth"
TRUTH_TRAJECTORY = "trajectory.csv"
TRUTH_SIGNS = "signs.geojson"
FINISHED_TRAJECTORIES = ("trajectory.csv", "trajectory.pos")
BEARINGS = "bearings.csv"
CONTROL_SIGNS = "control_signs.geojson"
