"""Options of the range-decomposed filter: with what it needs to work, and as printed."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.documented import choice, count, documented, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options.ranging.range_decomposed import RangeDecomposed
from quietfix.systems.starts.start import Start

__all__ = ["Ra", "RaPaper"]


@dataclass(frozen=True)
class Ra(EstimatorOptions):
    r"""Range-decomposed filter (RA) with what it needs to work; see `RangeDecomposed`.

    .. math:: \hat r = \text{the root of } f(r) \text{ nearest to the orbit plane}, \qquad z = r_O + \hat r e, \qquad
              R = G\,\mathrm{diag}(\sigma^2)\,G^T

    with f the ranging equation of `quietfix.systems.fixes.ranging`; z is then the measurement of a Kalman filter.
    """

    plane_epochs: int = count("epochs whose orbit planes are clustered", 20, at_least=2)
    pattern: str = choice(
        "what is clustered: slopes (a, b) of the plane as in the paper, or its unit normal",
        "slopes",
        ("slopes", "normal"),
    )
    look_ahead: bool = documented(
        "true: the plane from the first epochs, the filter from epoch 0, as in the paper (not causal); "
        "false: the prior until the plane is known, then the stored epochs at once",
        False,
    )
    gate: float = number("positions with a larger NIS (3 degrees of freedom) are not used", 16.0, above=0)
    gate_after: int = count("epochs without this gate at the beginning", 10, at_least=0)
    minimum_height_km: float = number("roots lower than this above the equatorial radius are impossible [km]", 100.0)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return RangeDecomposed(
            name,
            model,
            motion,
            start,
            wiring,
            plane_epochs=self.plane_epochs,
            pattern="normal" if self.pattern == "normal" else "slopes",
            look_ahead=self.look_ahead,
            gate=self.gate,
            gate_after=self.gate_after,
            minimum_height=1e3 * self.minimum_height_km,
        )


@dataclass(frozen=True)
class RaPaper(EstimatorOptions):
    r"""Range-decomposed filter as printed by Wu, Xin and Wan.

    It differs from `Ra` in the printed choices only: the plane from 6 epochs that are known in advance and averaged as
    slopes, every positive root a candidate, the covariance at the measured root (37), no gate. After the singularity
    noise-shifted roots look precise there, and a third of the runs end far off.

    .. math:: \hat r = \text{the root of } f(r) \text{ nearest to the orbit plane}, \qquad z = r_O + \hat r e
    """

    plane_epochs: int = count("epochs whose orbit planes are clustered", 6, at_least=2)
    look_ahead: bool = documented("the plane from the first epochs, the filter from epoch 0 (not causal)", True)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return RangeDecomposed(
            name,
            model,
            motion,
            start,
            wiring,
            plane_epochs=self.plane_epochs,
            pattern="slopes",
            track="slopes",
            look_ahead=self.look_ahead,
            covariance_at="root",
            gate=None,
            minimum_height=None,
            by_likelihood=False,
        )
