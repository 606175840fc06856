"""What a system declares of one scenario: its parts, and what each estimator is given."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.late import Late
from quietfix.diagrams.assembly.map import BoundMap, View
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.quantities.frame import EARTH_FIXED, Frame, as_frame
from quietfix.systems.biases.bias import Bias
from quietfix.systems.clocks import Clock
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.wiring import Tails
from quietfix.systems.integration import LONGEST_STEP
from quietfix.systems.late.arrived import Clearing
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Assumed", "Model", "Part"]


class Part(Protocol):
    """Puts one thing on a bus: platforms, a target, a sensor with its errors, a prior. It may be used many times."""

    def __call__(self, bus: Bus, /) -> None:
        """Add its blocks to ``bus`` and publish its signals."""


@dataclass(frozen=True)
class Assumed:
    """What one estimator is given.

    Attributes
    ----------
    model : MeasurementModel
        The sensor as the estimator believes it to be.
    motion : MotionModel
        The motion as it believes it to be.
    start : Start
        How it begins.
    rows : sequence of str
        Names of the rows on its measurement port.
    takes : mapping of str to str
        Input ports and their signals, where they are not those of the same name. ``platforms`` is ``known`` unless it
        is said here; with ``noise_covariance`` in it, R comes with the measurement.
    clock : Clock, optional
        When measurements come; by default the model's.
    feedback : mapping of str to str
        Likewise, for signals that are there only when all is built.
    on_demand : mapping of str to callable
        Input ports that only some estimators have: ``(bus, estimator) -> signal`` makes what such a one gets.
    tails : Tails, optional
        Rows whose noise is not Gaussian; Kalman-type filters weigh them accordingly.
    clearings : sequence of Clearing
        What is between the signal ``raw`` and its rows, for an estimator that goes back to late measurements.
    """

    model: MeasurementModel
    motion: MotionModel
    start: Start
    rows: Sequence[str]
    takes: Mapping[str, str] = field(default_factory=dict)
    clock: Clock | None = None
    feedback: Mapping[str, str] = field(default_factory=dict)
    on_demand: Mapping[str, Callable[[Bus, Estimator], str]] = field(default_factory=dict)
    tails: Tails | None = None
    clearings: Sequence[Clearing] = ()


@dataclass(frozen=True)
class Model:
    """A scenario, declared: `quietfix.diagrams.assembly.build` makes the diagram of it.

    Attributes
    ----------
    clock : Clock
        When measurements come.
    duration : float
        Length of a run [s].
    divergence : float
        Position error at the last epoch beyond which a trial counts as diverged [m].
    parts : sequence of Part
        In the order in which signals are needed. They publish ``truth``, ``platforms``, ``measurement`` and what the
        estimators take; ``known`` and ``raw`` where these are something else.
    assume : callable
        ``(bus, name, options) -> Assumed``: what the estimator of that name is given. It may add blocks of its own, or
        such as only some estimators need.
    truth_motion : MotionModel, optional
        The motion that the truth really has, for the bound that does not know the filter's process noise (of a rocket:
        deviations from a flight whose acceleration is known); None where it is none of the models, and that bound is
        then NaN.
    platforms : sequence of str, optional
        Names of what carries the sensors, in the order of the signal ``platforms``; by default ``platform_0`` ...
    frame : Frame, or its name
        Axes of states and platforms, of `quietfix.diagrams.quantities.frame.FRAMES`; `axes` is the frame itself.
    truth_states : sequence of str, optional
        Names of the components on ``truth``; by default those of `truth_motion` or of the target's own motion model.
    signals : mapping of str to str
        What else is worth a log: its name there and its signal; left out where the diagram has no such signal.
    rows : sequence of str, optional
        Names of the rows of ``raw`` (of ``measurement``, where there is no ``raw``), where not all estimators are wired
        to it as it is.
    note : str
        What a reader of the results must know; printed below the table.
    convergence : float or None
        The convergence time is when the RMSE of the position falls below this for good [m]; None: as `metrics` has it.
    widest : int, optional
        Most trials at once, where blocks need much memory of their own for each.
    step : float
        The longest step of the integration of blocks with continuous states [s]; see `quietfix.systems.integration`.
    recorded : Recorded, optional
        What makes it a recording: measurements are played, not simulated.
    late : Late, optional
        What of the signal ``measurement`` comes late; None: nothing.
    map : callable, optional
        ``() -> BoundMap``: where targets may be and what their bound depends on, for ``quietfix gdop``; by default
        those of `quietfix.diagrams.maps.default`.
    view : View, optional
        What those show.
    biases : sequence of Bias
        Biases of the measurement that Gaussian filters know may be there: they stand behind the states of `assume`.
    """

    clock: Clock
    duration: float
    divergence: float
    parts: Sequence[Part]
    assume: Callable[[Bus, str, Any], Assumed]
    truth_motion: MotionModel | None = None
    platforms: Sequence[str] | None = None
    frame: Frame | str = EARTH_FIXED
    truth_states: Sequence[str] | None = None
    signals: Mapping[str, str] = field(default_factory=dict)
    rows: Sequence[str] | None = None
    note: str = ""
    convergence: float | None = None
    widest: int | None = None
    step: float = LONGEST_STEP
    recorded: Recorded | None = None
    late: Late | None = None
    map: Callable[[], BoundMap] | None = None
    view: View | None = None
    biases: Sequence[Bias] = ()

    def __post_init__(self) -> None:
        """Check the frame.

        Raises
        ------
        UserError
            If it is none.
        """
        as_frame(self.frame)

    @property
    def axes(self) -> Frame:
        """The frame."""
        return as_frame(self.frame)
