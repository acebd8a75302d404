"""Marker poses refined from a recorded drive, by bundle adjustment."""
