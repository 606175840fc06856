"""A target that is where a platform is: nothing that is measured there has a derivative."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.own.declaring.sensing import PlacedSensor
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.paths.functions import Path
from quietfix.diagrams.paths.movers import RandomMotion
from quietfix.diagrams.schema.errors import UserError

__all__ = ["check_apart"]

Array = NDArray[np.float64]

_CLOSEST = 1e-3  # m
_INSTANTS = 60  # a course that meets a platform in between is met at no instant of a measurement, or at one of many


def check_apart(
    scenario: OwnScenario, sensors: Sequence[PlacedSensor], target: Path, platforms: Callable[[float], Array]
) -> None:
    """Refuse a target that is where one of its sensors is: the bound would count none of what is measured then.

    Looked at are the first measurement of every sensor and some 60 later ones; of a random motion its start alone.

    Raises
    ------
    UserError
        Naming the platform.
    """
    random = isinstance(scenario.target, RandomMotion)
    if isinstance(scenario.target, RandomMotion) and scenario.target.sigma_position_m > 0:
        return
    names = list(scenario.platforms)
    for one in sensors:
        used = one.real.platforms_used(len(names)).any(axis=0)
        ticks = one.clock.ticks(scenario.duration_s)
        for t in ticks[:: max(1, len(ticks) // _INSTANTS)]:
            if random and t > 0:
                break
            apart = np.linalg.norm(platforms(float(t)).reshape(-1, 6)[:, :3] - target(float(t))[:3], axis=1)
            near = np.flatnonzero(used & (apart < _CLOSEST))
            if near.size:
                raise UserError(
                    f"target: at {t:g} s it is where platforms.{names[near[0]]} is, which has no direction to it; move "
                    "one of them by a metre"
                )
