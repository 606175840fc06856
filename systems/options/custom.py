"""A user's own estimator class, named by where it is."""

from dataclasses import dataclass
from typing import Any

from quietfix.systems.documented import documented, text
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman_options import kalman_block
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.recovery.gate import Gate
from quietfix.systems.filters.recovery.heavy_tails import Huber, Student
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.registry import blamed, in_one_line, lines_of, object_at
from quietfix.systems.starts.start import Start

__all__ = ["Custom"]


@dataclass(frozen=True)
class Custom(EstimatorOptions):
    """``!Custom {class: package.module:Class, options: {...}}``.

    The class is either an `Estimator`, made as ``Class(name, model, motion, start, wiring, **options)``, or a
    `GaussianFilter`, made as ``Class(**options)`` and put behind the common ports.
    """

    class_: str = text("where the class is: package.module:Class")
    options: dict[str, bool | int | float | str] = documented("keyword arguments of the class", factory=dict)
    gate: Gate | None = documented("of a GaussianFilter: leaves out what the prediction makes improbable", None)
    robust: Huber | Student | None = documented("of a GaussianFilter: update for heavy tails, !Huber or !Student", None)
    restart: bool = documented("a trial that is lost begins again from a measurement, where the start does", False)

    @property
    def takes_biases(self) -> bool:
        """See `EstimatorOptions.takes_biases`; a class that cannot be found is named by `make`."""
        try:
            kind = object_at(self.class_)
        except ValueError:
            return True
        return isinstance(kind, type) and issubclass(kind, GaussianFilter)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block.

        Raises
        ------
        ValueError
            If the class cannot be found, is neither kind, refuses the options, or fails.
        """
        try:
            kind = object_at(self.class_)
        except ValueError as error:
            raise ValueError(f"estimators.{name}.{error}") from error
        try:
            return self._made(kind, name, model, motion, start, wiring)
        except KeyboardInterrupt:
            raise
        except TypeError as error:
            raise ValueError(f"estimators.{name}.options: {self.class_} says: {in_one_line(error)}") from error
        except BaseException as error:  # whatever a user's class does while it is made, sys.exit too
            if isinstance(error, ValueError) and not self.raised(error):
                raise  # a block of ours says what is wrong with its arguments
            raise ValueError(self.blame(name, error)) from error

    def _made(
        self, kind: Any, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring
    ) -> Estimator:
        if not isinstance(kind, type) or not issubclass(kind, Estimator | GaussianFilter):
            raise ValueError(
                f"estimators.{name}.class: {self.class_} is not allowed; a subclass of "
                "quietfix.systems.estimators.base.Estimator or quietfix.systems.filters.gaussian.GaussianFilter"
            )
        # by hand: Drake's own metaclass keeps Python from counting the abstract methods of a block
        lacking = [m for m in dir(kind) if getattr(getattr(kind, m, None), "__isabstractmethod__", False)]
        if lacking:
            raise ValueError(f"estimators.{name}.class: {self.class_} lacks {', '.join(lacking)}")
        if issubclass(kind, GaussianFilter):
            algorithm: GaussianFilter = kind(**self.options)
            algorithm = algorithm if self.robust is None else self.robust.around(algorithm)
            return kalman_block(name, algorithm, model, motion, start, wiring, self)
        for field in ("gate", "robust"):
            if getattr(self, field) is not None:
                raise ValueError(
                    f"estimators.{name}.{field}: it is not allowed here; null, for {self.class_} is a whole estimator, "
                    "and only a GaussianFilter is put behind one"
                )
        block = kind(name, model, motion, start, wiring, **self.options)
        block.restart_when_lost(self.restart, f"estimators.{name}.restart")
        return block

    def blame(self, name: str, error: BaseException) -> str:
        """Return in one line what the class raised, and where in its file."""
        return f"estimators.{name}.class: {blamed(self.class_, error)}"

    def raised(self, error: BaseException) -> bool:
        """Return whether an error was on its way through the class's file."""
        return bool(lines_of(self.class_, error))
