"""Studies as one HTML page."""
