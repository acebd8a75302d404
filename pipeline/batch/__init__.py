"""The compiled parts of `pipeline.batch_pose`: imported late, for they import numba."""
