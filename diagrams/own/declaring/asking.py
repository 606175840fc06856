"""A user's own models asked once before anything runs: what is wrong is refused, what is doubtful is told."""

from __future__ import annotations

import numpy as np

from quietfix.diagrams.own.declaring.beginning import Surroundings
from quietfix.systems.measurement.custom import CustomMeasurement
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.custom import CustomMotion

__all__ = ["ask_own"]


def ask_own(around: Surroundings, motion: MotionModel, simulated: bool) -> str:
    """Ask a user's own models at the target, of measurements at the first of each; return what is doubtful.

    Parameters
    ----------
    around : Surroundings
        With the sensors.
    motion : MotionModel
        What estimators believe in; asked at 0 where nobody knows the target.
    simulated : bool
        Whether there are measurements to be made; of others nobody knows where the target was then.

    Raises
    ------
    UserError
        If what one returns is no measurement or no motion; see their `check`.
    """
    doubts = [_ask_motion(around, motion)]
    if simulated:
        doubts += _ask_sensors(around)
    return " ".join(dict.fromkeys(doubt for doubt in doubts if doubt))


def _ask_motion(around: Surroundings, motion: MotionModel) -> str:
    if not isinstance(motion, CustomMotion):
        return ""
    state = np.stack([np.zeros(6) if around.target is None else around.target(0.0)] * 2)
    motion.check(state, around.scenario.period_s)
    return motion.doubt(state, around.scenario.period_s)


def _ask_sensors(around: Surroundings) -> list[str]:
    assert around.target is not None
    doubts = []
    for kind in around.kinds:
        time = kind.timed.offset_s
        target, platforms = np.zeros((2, around.states)), around.carriers(time).reshape(-1, 6)
        target[:, :6] = around.target(time)
        for model in {id(model): model for model in (kind.real, kind.believed)}.values():
            if isinstance(model, CustomMeasurement):
                model.check(target, np.stack([platforms] * 2))
                doubts.append(model.doubt(target, np.stack([platforms] * 2)))
    return doubts
