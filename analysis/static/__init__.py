"""Studies of a camera that stands still: placement, number of markers, variances."""
