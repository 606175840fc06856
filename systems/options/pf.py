"""The particle filter with progressive correction as an estimator."""

from dataclasses import dataclass

from quietfix.systems.documented import choice, count, documented, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.particle import ParticleEstimator
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.particle.resampling import SCHEMES
from quietfix.systems.filters.particle.update import ParticleUpdate
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Pf"]


@dataclass(frozen=True)
class Pf(EstimatorOptions):
    """Particle filter: progressive correction (tempering) with a shrunk kernel."""

    particles: int = count("particles per trial", 10_000, at_least=2)
    effective_share: float = number(
        "a tempering stage keeps this effective share of the particles; fewer after the last one are resampled",
        0.5,
        above=0,
        at_most=0.99,
    )
    resampling: str = choice("scheme of resampling", "systematic", tuple(SCHEMES))
    window: int = count("updates over which unique ancestors are counted; 0: since the start", 30, at_least=0)
    restart: bool = documented("begin again from the measurement after divergence, where the start knows how", True)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        update = ParticleUpdate(self.effective_share, True, self.effective_share, self.resampling)
        return ParticleEstimator(name, update, model, motion, start, wiring, self.particles, self.window, self.restart)
