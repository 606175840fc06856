"""How wrapped phases of a system of one's own are resolved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.own.declaring.sensing import Measured
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.kinds.phase import Phase
from quietfix.diagrams.parts.resolving import PhaseResolution
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.atmosphere.delayed import in_vacuum
from quietfix.systems.estimators.phase_resolver import PhaseCycles
from quietfix.systems.measurement.tdoa import Tdoa

__all__ = ["Resolvers", "open_cycles", "phase_resolvers", "two_differences"]

Array = NDArray[np.float64]

_NAME = "phase_resolver"


@dataclass(frozen=True)
class Resolvers:
    """The resolvers of all wrapped phases, one behind the other; none: the estimators get what is measured.

    Attributes
    ----------
    rows : sequence of str
        All that is measured.
    each : mapping of str to PhaseResolution
        By the kind of measurement that it resolves.
    """

    rows: Sequence[str]
    each: Sequence[PhaseResolution]

    @property
    def signals(self) -> dict[str, str]:
        """What is worth a log: the cycles that were added."""
        return {one.name.replace(_NAME, "integers"): f"{one.name}.integers" for one in self.each}

    def on(self, bus: Bus) -> list[str]:
        """Return the names of the rows of ``measurement``; what resolves phases is added if it is not there yet."""
        for one in self._in_turn():
            one.on(bus)
        return list(self.clearings[-1].stream)

    @property
    def clearings(self) -> list[PhaseCycles]:
        """What they do, one after the other."""
        return [one.cycles for one in self._in_turn()]

    def _in_turn(self) -> list[PhaseResolution]:
        rows, found = list(self.rows), []
        for one in self.each:
            found.append(replace(one, rows=rows))
            rows = list(found[-1].cycles.stream)
        return found


def two_differences(kinds: Sequence[Measured]) -> dict[str, Measured]:
    """Return the kinds of measurement that, with a height, make a fix: TDOAs of two rows."""
    return {kind.name: kind for kind in kinds if isinstance(in_vacuum(kind.believed), Tdoa) and kind.believed.size == 2}


def open_cycles(kinds: Sequence[Measured], spread: Array | None, target: Array, platforms: Array) -> str:
    r"""Return a note on wrapped phases that nothing resolves and whose cycle the start leaves open; empty: none.

    The cycle next to the prediction is the right one where the error of the two together,
    :math:`\sqrt{h^T P h + \sigma^2}`, is below half a cycle; three standard deviations of it are asked for.

    Parameters
    ----------
    kinds : sequence of Measured
    spread : ndarray, shape (1, n, n), optional
        Covariance of the start; None: it cannot be said.
    target, platforms : ndarray, shapes (1, n) and (1, p, 6)
        At the start.
    """
    said: list[str] = []
    for kind in kinds:
        model = kind.cleared
        if spread is None or not (isinstance(model, InterferometerPhase) and model.wrapped):
            continue
        slope = model.jacobian(target, platforms)
        variance = np.einsum("...ij,...jk,...ik->...i", slope, spread, slope) + model.sigma**2
        cycles = 3 * float(np.sqrt(np.nanmax(variance))) / (2 * np.pi)
        if cycles > 0.5:
            said.append(
                f"{kind.name} is wrapped, nothing resolves it, and the start leaves its phase open by {cycles:.2g} "
                "cycles (3 sigma): resolved_by or chain_m."
            )
    return " ".join(said)


def phase_resolvers(scenario: OwnScenario, kinds: Sequence[Measured], states: int) -> Resolvers:
    """Return what resolves the wrapped phases.

    Parameters
    ----------
    scenario : OwnScenario
    kinds : sequence of Measured
        All that is measured.
    states : int
        Components of the estimators' state.

    Raises
    ------
    UserError
        If phases cannot be resolved as a field says.
    """
    resolved = [kind for kind in kinds if kind.resolved]
    found: list[PhaseResolution] = []
    for kind in resolved:
        phase = kind.believed
        assert isinstance(phase, InterferometerPhase)
        found.append(
            PhaseResolution(
                (),
                phase,
                _delays(scenario, kind, kinds),
                kind.links,
                states,
                f"{found[-1].name}.measurement" if found else "raw",
                _NAME if len(resolved) == 1 else f"{_NAME}_{kind.name}",
            )
        )
    rows = [row for kind in kinds for model in (kind.real, *kind.links) for row in model.names]
    return Resolvers(rows, found)


def _delays(scenario: OwnScenario, kind: Measured, kinds: Sequence[Measured]) -> Tdoa | None:
    """Return the TDOA that resolves phases; None: a chain does."""
    field, where = kind.field, f"{kind.where}.resolved_by"
    assert isinstance(field, Phase)
    if not field.wrapped:
        what = "resolved_by" if field.resolved_by else "chain_m"
        raise UserError(f"{kind.where}.{what}: {getattr(field, what)} is not allowed; the phase is not wrapped")
    if not field.resolved_by:
        return None
    if field.chain_m:
        raise UserError(f"{where}: {field.resolved_by} is not allowed beside chain_m, which resolves the phase")
    if not scenario.axes.geodetic:
        raise UserError(f"{where}: it is for frame earth_fixed only, this is {scenario.frame}")
    able = two_differences(kinds)
    if not able:
        raise UserError(f"{where}: {field.resolved_by} is not allowed; there is no !Tdoa of two rows")
    delays = able[choose(where, field.resolved_by, able)]
    ticks = kind.clock.ticks(scenario.duration_s) if scenario.measurements is None else ()
    late = [float(t) for t in ticks if delays.clock.index(float(t)) is None]
    if late:
        raise UserError(
            f"{where}: {field.resolved_by} is not allowed; at {late[0]:g} s the phase is measured, and it is not"
        )
    if not isinstance(delays.believed, Tdoa):
        raise UserError(f"{where}: {field.resolved_by} is not allowed in an atmosphere; chain_m")
    return delays.believed
