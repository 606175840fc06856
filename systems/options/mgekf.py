"""The modified gain extended Kalman filter as an estimator."""

from dataclasses import dataclass

from quietfix.systems.estimators.kalman_options import FilterOptions
from quietfix.systems.filters.modified_gain import ModifiedGainKalman

__all__ = ["Mgekf"]


@dataclass(frozen=True)
class Mgekf(ModifiedGainKalman, FilterOptions):
    """Modified gain extended Kalman filter; for measurements other than bearings it is the EKF."""
