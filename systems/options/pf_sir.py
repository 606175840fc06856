"""The bootstrap particle filter as an estimator."""

import math
from dataclasses import dataclass

from systems.documented import choice, count
from systems.estimators.base import Estimator
from systems.estimators.options import EstimatorOptions
from systems.estimators.particle import ParticleEstimator
from systems.estimators.wiring import Wiring
from systems.filters.particle.resampling import SCHEMES
from systems.filters.particle.update import ParticleUpdate
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.starts.start import Start

__all__ = ["PfSir"]


@dataclass
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
