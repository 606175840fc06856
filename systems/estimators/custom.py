"""A user's own estimator class, named by where it is."""

import sys
import traceback
from dataclasses import dataclass
from pathlib import Path

from systems.documented import documented, text
from systems.estimators.base import Estimator, Wiring
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.options import EstimatorOptions
from systems.estimators.start import Start
from systems.filters.gaussian import GaussianFilter
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.registry import in_one_line, locate

__all__ = ["Custom"]


@dataclass
class Custom(EstimatorOptions):
    """``!Custom {class: package.module:Class, options: {...}}``.

    The class is either an `Estimator`, made as ``Class(name, model, motion, start, wiring, **options)``, or a
    `GaussianFilter`, made as ``Class(**options)`` and put behind the common ports.
    """

    class_: str = text("where the class is: package.module:Class")
    options: dict[str, bool | int | float | str] = documented("keyword arguments of the class", factory=dict)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block.

        Raises
        ------
        ValueError
            If the class cannot be found, is neither kind, refuses the options, or fails.
        """
        kind = locate(self.class_)
        if not isinstance(kind, type) or not issubclass(kind, Estimator | GaussianFilter):
            raise ValueError(
                f"estimators.{name}.class: {self.class_} is not allowed; a subclass of "
                "systems.estimators.base.Estimator or systems.filters.gaussian.GaussianFilter"
            )
        # by hand: Drake's own metaclass keeps Python from counting the abstract methods of a block
        lacking = [m for m in dir(kind) if getattr(getattr(kind, m, None), "__isabstractmethod__", False)]
        if lacking:
            raise ValueError(f"estimators.{name}.class: {self.class_} lacks {', '.join(lacking)}")
        try:
            if issubclass(kind, GaussianFilter):
                return KalmanEstimator(name, kind(**self.options), model, motion, start, wiring)
            return kind(name, model, motion, start, wiring, **self.options)
        except TypeError as error:
            raise ValueError(f"estimators.{name}.options: {self.class_} says: {error}") from error
        except ValueError:
            raise
        except Exception as error:  # whatever a user's class does while it is made
            raise ValueError(self.blame(name, error)) from error

    def blame(self, name: str, error: Exception) -> str:
        """Return in one line what the class raised, and where in its file."""
        file = getattr(sys.modules.get(self.class_.partition(":")[0]), "__file__", None)
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
        where = f" ({Path(file).name}, line {lines[-1]})" if file and lines else ""
        return f"estimators.{name}.class: {self.class_} failed with {in_one_line(error)}{where}"
