"""What surrounds an estimator in a diagram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from quietfix.systems.clocks import Clock
from quietfix.systems.signals import check_trials

__all__ = ["Tails", "Wiring"]


class Tails(NamedTuple):
    """Rows whose noise has tails as Student's t.

    Attributes
    ----------
    rows : tuple of str
        Their names.
    freedom : float
        Degrees of freedom; the fewer the heavier.
    """

    rows: tuple[str, ...]
    freedom: float


@dataclass(frozen=True)
class Wiring:
    """What surrounds an estimator; the same for all estimators of a diagram.

    Parameters
    ----------
    trials : int
        Trials of the ensemble.
    stream : sequence of str
        Names of the rows on the measurement port; an estimator picks those of its own model by name.
    clock : Clock
        When measurements come.
    platforms : int
        Number of platforms on the port, six numbers each.
    platform_trials : int
        1 where all trials share the platforms, else `trials`.
    noise_port : bool
        True where R comes with the measurement, on the port ``noise_covariance``.
    tails : Tails, optional
        Rows whose noise is not Gaussian; Kalman-type filters weigh them accordingly.
    level : bool
        True where z is up, everywhere: turns about the vertical are turns about one axis.
    """

    trials: int
    stream: Sequence[str]
    clock: Clock
    platforms: int
    platform_trials: int = 1
    noise_port: bool = False
    tails: Tails | None = None
    level: bool = False

    def __post_init__(self) -> None:
        """Check the arguments."""
        check_trials(self.trials)
        if self.platform_trials not in (1, self.trials):
            raise ValueError(f"platforms have {self.platform_trials} trials; 1 or {self.trials} are allowed")
