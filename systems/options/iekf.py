"""The iterated extended Kalman filter as an estimator."""

from dataclasses import dataclass

from quietfix.systems.estimators.kalman_options import FilterOptions
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman

__all__ = ["Iekf"]


@dataclass(frozen=True)
class Iekf(IteratedExtendedKalman, FilterOptions):
    """Iterated extended Kalman filter."""
