"""Whether two peers have solved the same problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchmarks.own_peers import History

__all__ = ["Agreement", "agreement"]


@dataclass(frozen=True)
class Agreement:
    """Largest differences over all epochs and trials.

    Attributes
    ----------
    position, velocity : float
        [m], [m/s].
    covariance : float
        Of any element of the covariance, in units of the two standard deviations it belongs to.
    """

    position: float
    velocity: float
    covariance: float

    def require(self, position: float, covariance: float, what: str) -> str:
        """Return the sentence for the table, or raise ArithmeticError: then a ratio of times would mean nothing.

        Parameters
        ----------
        position, covariance : float
            Tolerances [m] and in units of standard deviations; the velocity's is that of the position per second.
        what : str
            Who is compared.
        """
        found = (
            f"{what} agree over all epochs and trials within {self.position:.1e} m, {self.velocity:.1e} m/s and "
            f"{self.covariance:.1e} of a variance (required: {position:.0e} m, {position:.0e} m/s, {covariance:.0e})"
        )
        # Written so that NaN does not pass.
        if not (self.position <= position and self.velocity <= position and self.covariance <= covariance):
            raise ArithmeticError(f"not so: {found}")
        return found


def agreement(one: History, other: History) -> Agreement:
    """Hold means (..., n) and covariances (..., n, n) of two peers against each other; three axes each."""
    moved = np.abs(one[0] - other[0])
    sigma = np.sqrt(np.einsum("...ii->...i", one[1]))
    spread = np.abs(one[1] - other[1]) / (sigma[..., :, None] * sigma[..., None, :])
    return Agreement(float(moved[..., :3].max()), float(moved[..., 3:].max()), float(spread.max()))
