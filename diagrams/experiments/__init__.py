"""Studies of studies: comparisons, sweeps, observability."""
