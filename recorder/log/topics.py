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

# Which of them an attachment gives.
SHOWN_ON = {
    CAMERA_FILE: {CALIBRATION},
    MAP_FILE: {TRANSFORMS},
    **{name: {TRUTH_PATH, TRUTH_POSE} for name in TRUTH_FILES},
}

# In the session of a source that does not wait.
LIVE = "live"
QUEUE = "queue"

# In the session of a part of a recording that was split.
RECORDING = "recording"
RECORDING_START = "recording_start_ns"
PART = "part"
