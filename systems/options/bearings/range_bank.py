"""A bank of filters over the range as an estimator."""

from dataclasses import dataclass

from quietfix.systems.documented import choice, count, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.range_parameterised import RangeParameterised
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.modified_gain import ModifiedGainKalman
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.bearing_start import BearingStart
from quietfix.systems.starts.start import Start

__all__ = ["RangeBank"]


@dataclass(frozen=True)
class RangeBank(EstimatorOptions):
    """The same filter started from several ranges, weighted by how well each predicts the bearings."""

    filter: str = choice("filter of each hypothesis", "iekf", ("ekf", "iekf", "mgekf", "ukf"))
    hypotheses: int = count("intervals of range, in geometric progression", 8)
    nearest_km: float = number("the target is not nearer than this at the start [km]", 5.0, above=0)
    farthest_km: float = number("nor farther than this [km]", 150.0, above=0)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        filters: dict[str, GaussianFilter] = {
            "ekf": IteratedExtendedKalman(max_iterations=1),
            "iekf": IteratedExtendedKalman(),
            "mgekf": ModifiedGainKalman(),
            "ukf": UnscentedKalman(),
        }
        if not isinstance(start, BearingStart):
            raise ValueError(
                f"{name}: hypotheses of range need a start from the first bearing in a plane, as in bearing_crossing"
            )
        return RangeParameterised(
            name,
            filters[self.filter],
            model,
            motion,
            start,
            wiring,
            self.nearest_km * 1e3,
            self.farthest_km * 1e3,
            self.hypotheses,
        )
