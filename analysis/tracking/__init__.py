"""Drives: how well each tracker follows, and whether its covariance says so."""
