"""Fixes: a position from one epoch's measurements, with its covariance."""
