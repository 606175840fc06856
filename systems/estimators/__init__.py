"""Estimator blocks: the same ports and the same meaning, whatever is inside."""
