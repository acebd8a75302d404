"""The names in a log, and the version of its format."""

from __future__ import annotations

LOG_FORMAT = "1"

IMAGE = "/camera/image"
CALIBRATION = "/camera/calibration"
TRANSFORMS = "/tf"
TRUTH_PATH = "/truth/path"
TRUTH_POSE = "/truth/pose"
TRUTH_EXACT = "/truth/exact"
EVENTS = "/events"

# Written from the attachments for viewers that do not know them.
DERIVED = frozenset({CALIBRATION, TRANSFORMS, TRUTH_PATH, TRUTH_POSE})

CAMERA_FILE = "camera.yaml"
MAP_FILE = "map.yaml"
TRUTH_FILES = ("truth.yaml", "truth.csv", "truth.tum")

CAMERA_FRAME = "camera"
MAP_FRAME = "map"  # the name where no map gives one

SESSION = "session"
SESSION_END = "session_end"
