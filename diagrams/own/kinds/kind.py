"""What a kind of measurement says of itself: all that knows kinds follows from it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from quietfix.diagrams.parts.impairment import Mount
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.quantities.frame import Frame
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Alias", "ExcessPath", "MeasurementKind", "Row"]


@dataclass(frozen=True)
class Alias:
    """Another name that a table may have for a row, and how its values become those of the row.

    Attributes
    ----------
    kind : str
        The name.
    offset : float
        Added to a value [SI].
    compass : bool
        Whether values are clockwise from north, and the row's counter-clockwise from east.
    """

    kind: str
    offset: float = 0.0
    compass: bool = False


@dataclass(frozen=True)
class Row:
    """A row of the stream of measurements, and what a table of measurements calls it.

    Attributes
    ----------
    kind, receiver, reference : str
        As a table names it; empty: it has none.
    unit : str
        SI; `quietfix.diagrams.readers.units` has what else a table may say.
    label : str
        Its name, where that is not ``KIND_RECEIVER_REFERENCE`` without what it does not have.
    aliases : tuple of Alias
        Other names that a table may have for it.
    largest : float
        A larger value [SI] cannot be; 0: there is no limit.
    largest_words : str
        The same in words.
    carrier : float
        What a received frequency is counted from [Hz]; 0 of other rows.
    compares_clocks : bool
        Whether it is a difference of times at two platforms' clocks, which light bounds.
    """

    kind: str
    receiver: str
    reference: str
    unit: str
    label: str = ""
    aliases: tuple[Alias, ...] = ()
    largest: float = 0.0
    largest_words: str = ""
    carrier: float = 0.0
    compares_clocks: bool = False

    @property
    def name(self) -> str:
        """What estimators and results call it."""
        return self.label or "_".join(part for part in (self.kind, self.receiver, self.reference) if part)

    @property
    def compass(self) -> bool:
        """Whether it is an azimuth from east to north, which a table may have as a bearing."""
        return any(alias.compass for alias in self.aliases)


@dataclass(frozen=True)
class ExcessPath:
    """How a row changes where a signal's path is longer than in vacuum.

    Attributes
    ----------
    scale : float
        What is added to a row, per metre of the path to its receiver, less that to its reference if it has one.
    doppler : bool
        Whether it is per m/s of the path of the carrier's phase instead.
    carrier : float, optional
        Frequency of the signal [Hz]; None: it does not say.
    """

    scale: float
    doppler: bool = False
    carrier: float | None = None


@dataclass
class MeasurementKind(ABC):
    """A kind of measurement as a user writes it; the class name is the YAML tag, the fields are its options.

    `model` is all that must be there: its rows are then called as it calls them. A clock, a mask and errors are not
    in it: `quietfix.diagrams.own.fields.sensors` makes a sensor of every kind.

    Attributes
    ----------
    compares_clocks : bool
        Whether its rows compare the clocks of two platforms, so that one of them can be off.
    directions : str
        Where its rows are directions, so that `mounts` has something: for messages, as in ``a !Bearing in local axes``.
    """

    compares_clocks: ClassVar[bool] = False
    directions: ClassVar[str] = ""

    @abstractmethod
    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; a `UserError` that begins with `where` says what cannot be."""

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """Return what its rows are, in the order of the model: by default of no platform, and named as in the model."""
        return [Row(name, "", "", unit) for name, unit in zip(model.names, model.units, strict=True)]

    def mounts(self, model: MeasurementModel, rows: Sequence[str], frame: Frame) -> list[Mount]:
        """Return which rows are directions, in whose axes; by default none."""
        return []

    def excess_path(self) -> ExcessPath | None:
        """Return what an atmosphere adds to its rows; by default None, as in vacuum."""
        return None

    def placed(self, places: Places, where: str) -> tuple[MeasurementModel, list[Row]]:
        """Return the model, its rows named, and what they are."""
        model = self.model(places, where)
        rows = self.rows(places, model)
        named = tuple(row.name for row in rows)
        if named != tuple(model.names):
            model.names = named
        return model, rows
