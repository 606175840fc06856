"""What estimators believe of biases, as a user writes it, and which of a system's rows that is about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from quietfix.diagrams.parts.impairment import Mount
from quietfix.diagrams.parts.sensor_errors import SensorErrors
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.biases.bias import Bias, Turn
from quietfix.systems.documented import choice, documented, number
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["BIASES", "BelievedBias", "Biasable", "believed_biases", "groups_of", "row_units"]

_TURNS = ("roll", "pitch", "yaw")
_SCALES = {"s": (1e-9, "ns"), "rad": (np.pi / 180, "deg")}
"""By the unit of a row: in what its biases are written, as its sigma is; else in the row's own."""


@dataclass
class BelievedBias:
    """What the estimators believe of a bias; ns where a row is a time, deg of an angle, else the row's own unit."""

    sigma: float | None = number("its standard deviation at the start, in ns, deg, Hz, m, m/s ...", None, above=0)
    walk: float = number("standard deviation that it gains in a second, in that unit per root s", 0.0, at_least=0)
    mode: str = choice("it is a state, or its uncertainty counts only (Schmidt)", "estimate", ("estimate", "consider"))
    shared: bool = documented("one for all rows of the group, instead of one for each", False)


BIASES = (
    "biases that the estimators know may be there, by what has one: a row, a group of rows, clock_PLATFORM, "
    "roll_PLATFORM, pitch_PLATFORM, yaw_PLATFORM"
)
"""What the field ``biases`` of a scenario's belief is."""


@dataclass(frozen=True)
class Biasable:
    """What of a system may have a bias.

    Attributes
    ----------
    rows : mapping of str to str
        Names of all rows that are measured, and their units.
    groups : mapping of str to sequence of str
        Rows that have a name together.
    clocks : mapping of str to (int, int)
        Rows that are a difference of times at two platforms' clocks: the receiver and the reference.
    mounts : sequence of Mount
        Rows that are directions, and whose axes they are in.
    platforms : sequence of str
        Names of the platforms.
    axes : int
        Space dimensions of the target's state.
    errors : SensorErrors, optional
        Of the truth: what is constant of them is where bounds take their derivatives.
    """

    rows: Mapping[str, str]
    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)
    clocks: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    mounts: Sequence[Mount] = ()
    platforms: Sequence[str] = ()
    axes: int = 3
    errors: SensorErrors | None = None

    def _clock(self, platform: int) -> dict[str, float]:
        """Return how an advance of a platform's clock enters the rows."""
        found = {row: float(a == platform) - float(b == platform) for row, (a, b) in self.clocks.items()}
        return {row: share for row, share in found.items() if share}

    def _turns(self) -> dict[str, tuple[Mount, int]]:
        """Return axes that may be turned, by the name of that."""
        about = enumerate(_TURNS) if self.axes == 3 else [(2, "yaw")]
        found: dict[str, tuple[Mount, int]] = {}
        for k, turn in about:
            for mount in self.mounts:
                name = f"{turn}_{self.platforms[mount.platform]}"
                known = found.get(name)
                rows = [*(known[0].rows if known else ()), *mount.rows]
                found[name] = Mount(rows, mount.platform, mount.body), k
        return found

    def biases(self, where: str, name: str, believed: BelievedBias) -> list[Bias]:
        """Return the biases that an entry of a scenario is about, in SI units.

        Raises
        ------
        UserError
            If nothing has that name, or something is not as it must be.
        """
        clocks = {f"clock_{platform}": self._clock(i) for i, platform in enumerate(self.platforms)}
        clocks, turns = {key: rows for key, rows in clocks.items() if rows}, self._turns()
        groups = {key: list(rows) for key, rows in self.groups.items() if key not in self.rows}
        choose(where, name, dict.fromkeys([*self.rows, *groups, *clocks, *turns]))
        if believed.sigma is None:
            raise UserError(f"{where}.{name}.sigma: none is given; a finite number > 0")
        many = groups.get(name, [])
        if believed.shared and len(many) < 2:
            raise UserError(f"{where}.{name}.shared: true is not allowed; it is for a group of rows")
        if name in turns:
            mount, about = turns[name]
            turn = Turn(mount.platform, about, self.axes, mount.body)
            return [self._bias(name, "rad", believed, dict.fromkeys(mount.rows, 1.0), turn)]
        if name in clocks:
            return [self._bias(name, "s", believed, clocks[name])]
        if name in self.rows:
            return [self._bias(f"bias_{name}", self.rows[name], believed, {name: 1.0})]
        if not believed.shared:
            return [self._bias(f"bias_{row}", self.rows[row], believed, {row: 1.0}) for row in many]
        units = {self.rows[row] for row in many}
        if len(units) > 1:
            raise UserError(f"{where}.{name}.shared: true is not allowed; its rows have the units {sorted(units)}")
        return [self._bias(f"bias_{name}", units.pop(), believed, dict.fromkeys(many, 1.0))]

    def _bias(
        self, name: str, unit: str, believed: BelievedBias, rows: Mapping[str, float], turn: Turn | None = None
    ) -> Bias:
        scale = _SCALES.get(unit, (1.0, unit))[0]
        assert believed.sigma is not None
        considered = believed.mode == "consider"
        sigma, walk = scale * believed.sigma, scale * believed.walk
        return Bias(name, unit, sigma, walk, dict(rows), considered, turn, self._true(name, turn))

    def _true(self, name: str, turn: Turn | None) -> float:
        errors = self.errors
        if errors is None:
            return 0.0
        if turn is not None:
            return float(np.radians(getattr(errors, f"attitude_{_TURNS[turn.about]}_deg")))
        late = f"clock_{self.platforms[errors.clock_offset_platform]}" if self.platforms else ""
        return 1e-9 * errors.clock_offset_ns if name == late else 0.0


def row_units(model: MeasurementModel) -> dict[str, str]:
    """Return the rows of a model and their units."""
    return dict(zip(model.names, model.units, strict=True))


def groups_of(models: Mapping[str, MeasurementModel]) -> dict[str, tuple[str, ...]]:
    """Return the rows of each of some models by its name."""
    return {name: tuple(model.names) for name, model in models.items()}


def believed_biases(
    believed: Mapping[str, BelievedBias], of: Biasable, where: str = "belief.biases"
) -> tuple[Bias, ...]:
    """Return the biases of a scenario, in the order in which it names them.

    Raises
    ------
    UserError
        For a name that nothing has, a bias that is there twice, and numbers that are not allowed.
    """
    found: dict[str, Bias] = {}
    for name, one in believed.items():
        for bias in of.biases(where, name, one):
            if bias.name in found:
                raise UserError(f"{where}.{name}: {bias.name} is not allowed twice; another entry has it already")
            found[bias.name] = bias
    return tuple(found.values())
