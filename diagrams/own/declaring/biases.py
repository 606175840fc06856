"""Which rows of a system of one's own may have biases, and what its estimators believe of them."""

from __future__ import annotations

from collections.abc import Sequence

from quietfix.diagrams.own.declaring.impairing import clocks_of, mounts_of
from quietfix.diagrams.own.declaring.sensing import PlacedSensor
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.parts.biases import Biasable, believed_biases, row_units
from quietfix.systems.biases.bias import Bias

__all__ = ["own_biases"]


def own_biases(scenario: OwnScenario, sensors: Sequence[PlacedSensor]) -> tuple[Bias, ...]:
    """Return the biases that the scenario's belief names: of rows, kinds, sensors, clocks and axes of platforms."""
    kinds, platforms = [kind for one in sensors for kind in one.kinds], list(scenario.platforms)
    groups = {kind.name: tuple(kind.believed.names) for kind in kinds}
    groups |= {one.name: tuple(row for kind in one.kinds for row in kind.believed.names) for one in sensors}
    clocks = {row: pair for kind in kinds for row, pair in clocks_of(kind, platforms).items()}
    of = Biasable(
        {row: unit for kind in kinds for row, unit in row_units(kind.believed).items()},
        groups,
        clocks,
        [mount for kind in kinds for mount in mounts_of(kind, scenario.axes)],
        platforms,
    )
    return believed_biases(scenario.belief.biases, of)
