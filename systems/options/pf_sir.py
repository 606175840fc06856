"""The bootstrap particle filter as an estimator."""

import math
from dataclasses import dataclass

from quietfix.systems.documented import choice, count
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.particle import ParticleEstimator
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.particle.resampling import SCHEMES
from quietfix.systems.filters.particle.update import ParticleUpdate
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["PfSir"]


@dataclass(frozen=True)
class PfSir(EstimatorOptions):
    """Bootstrap particle filter: particles move by the motion model, weights are likelihoods, resampled every epoch.

    Gordon, Salmond and Smith, *Novel approach to nonlinear/non-Gaussian Bayesian state estimation*, IEE Proc. F 140
    (1993) 107-113, and the dual-satellite patent: its weighted mean is the estimate. Where weights of the patent would
    all be 0 in floating point, logarithms are kept; nothing else is different. With sharp measurements it collapses,
    and ``diverged`` says so.
    """

    particles: int = count("particles per trial", 10_000, at_least=2)
    resampling: str = choice("scheme of resampling", "systematic", tuple(SCHEMES))

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        update = ParticleUpdate(share=None, kernel=False, threshold=math.inf, scheme=self.resampling)
        return ParticleEstimator(name, update, model, motion, start, wiring, self.particles)
