"""Whole steps of an estimator in one compiled call."""
