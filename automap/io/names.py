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
KML = "map.kml"
GPKG = "map.gpkg"
REPORT = "report.html"
RUN = "run.json"
REVIEW = "review.json"
REJECTED = "signs_rejected.geojson"
EVALUATION = "evaluation.json"

DEFAULT_OUT = "_automap"
MANIFEST = "drive.toml"
TRUTH_DIR = "truth"
TRUTH_TRAJECTORY = "trajectory.csv"
TRUTH_SIGNS = "signs.geojson"
FINISHED_TRAJECTORIES = ("trajectory.csv", "trajectory.pos")
BEARINGS = "bearings.csv"
