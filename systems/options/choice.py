"""The type of what stands under ``estimators:``, for a field of a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING

from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.registry import estimator_options

__all__ = ["EstimatorChoice"]

if TYPE_CHECKING:
    EstimatorChoice = EstimatorOptions
else:
    EstimatorChoice = estimator_options()
