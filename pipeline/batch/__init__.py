"""The parts of `pipeline.batch_pose`; `start` and `refine` are compiled and import numba."""
