"""Particle filters as estimator blocks."""

from __future__ import annotations

from collections.abc import Sequence

from systems.estimators.base import Estimator

__all__ = ["ParticleEstimator"]


class ParticleEstimator(Estimator):
    """Base of the particle filters."""

    def health_ports(self) -> Sequence[str]:
        """Return the names of the ports that tell how the cloud is."""
        return ()
