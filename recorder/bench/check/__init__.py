"""Is a ground truth plausible? Everything that can be said from its file, the map and the log."""
