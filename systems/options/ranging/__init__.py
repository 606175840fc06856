"""Estimators that take the roots of the ranging equation between two satellites, with their options."""
