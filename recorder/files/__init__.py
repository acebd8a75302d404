"""The files that people write: camera, marker map, truth."""
