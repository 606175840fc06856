"""Resolve the integers of wrapped interferometer phases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.earth.geodetic import vertical
from quietfix.systems.fixes.known_height import wave_front_fix
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.signals import EnsembleBlock

__all__ = ["PhaseCycles", "PhaseResolver", "resolve"]

Array = NDArray[np.float64]


def resolve(wrapped: Array, predicted: Array) -> tuple[Array, Array]:
    r"""Add the whole cycles that bring a wrapped phase next to a predicted one.

    Parameters
    ----------
    wrapped, predicted : ndarray, shape (...)
        Wrapped and predicted unambiguous phase [rad].

    Returns
    -------
    phase, integer : ndarray, shape (...)
        :math:`\varphi + 2\pi m` with :math:`m = \mathrm{round}((\hat\varphi - \varphi)/2\pi)`.
    """
    integer = np.round((predicted - wrapped) / (2 * np.pi))
    return wrapped + 2 * np.pi * integer, integer


class PhaseCycles:
    r"""Turns wrapped phases into unambiguous ones.

    Without a chain, as in section 2.2 of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005: a filter's
    predicted height and the TDOAs of the same instant give a position, its phase the integers.
    The TDOAs, not the predicted position: a height error moves their fix along the line of sight, which barely
    changes the phase. With a chain of shorter baselines every phase is resolved by the next shorter one, and the
    shortest must be at most half a wavelength; no prediction is then needed.

    .. math:: \phi = \phi_w + 2\pi N, \qquad N = \mathrm{round}\frac{\phi_{\mathrm{known}} - \phi_w}{2\pi}

    with :math:`\phi_{\mathrm{known}}` that of the fix, or of the next shorter baseline times the ratio of the lengths.

    Parameters
    ----------
    stream : sequence of str
        Names of the rows that come in.
    phase : InterferometerPhase
        The long baseline.
    tdoa : Tdoa, optional
        For the fix; without a chain only.
    chain : sequence of InterferometerPhase
        Shorter baselines, from the shortest; their rows are ``phase_a_1`` ... for the shortest.
    name : str
        For messages.

    Attributes
    ----------
    stream : list of str
        Names of the rows that come out: the chain's are dropped.
    """

    def __init__(
        self,
        stream: Sequence[str],
        phase: InterferometerPhase,
        tdoa: Tdoa | None,
        chain: Sequence[InterferometerPhase] = (),
        name: str = "phase_resolver",
    ) -> None:
        self._phase, self._tdoa = phase, tdoa
        self.chain = list(chain)
        if tdoa is None and not self.chain:
            raise ValueError(f"{name}: phases are resolved by TDOAs or by a chain of baselines; neither is there")
        lengths = [part.baseline for part in [*self.chain, phase]]
        if lengths != sorted(lengths):
            raise ValueError(f"chain of baselines: {lengths} must increase")
        if self.chain and lengths[0] > phase.wavelength / 2:
            raise ValueError(
                f"chain of baselines: the shortest, {lengths[0]:g} m, is not unambiguous; at most half a "
                f"wavelength, {phase.wavelength / 2:g} m"
            )
        stream = list(stream)
        links = [row for i in range(len(self.chain)) for row in self.link_names(phase, i)]
        self.stream: Sequence[str] = [row for row in stream if row not in links]
        self._kept = [stream.index(row) for row in self.stream]
        self._phase_rows = [list(self.stream).index(row) for row in phase.names]
        self._tdoa_rows = [] if tdoa is None else [stream.index(row) for row in tdoa.names]
        self._link_rows = [[stream.index(row) for row in self.link_names(phase, i)] for i in range(len(self.chain))]

    @staticmethod
    def link_names(phase: InterferometerPhase, link: int) -> tuple[str, ...]:
        """Return the row names of the chain's baseline number `link`, 0 the shortest."""
        return tuple(f"{row}_{link + 1}" for row in phase.names)

    def cleared(self, stream: Array, prediction: Array | None, platforms: Array) -> tuple[Array, Array]:
        """Return the rows with unambiguous phases (trials, len(self.stream)), and the integers.

        Parameters
        ----------
        stream : ndarray, shape (trials, rows)
            What was measured at one instant.
        prediction : ndarray, shape (trials, n), or None
            The state then; it is not looked at where there is a chain.
        platforms : ndarray, shape (1 or trials, p, 6)
        """
        kept = stream[:, self._kept].copy()
        wrapped = kept[:, self._phase_rows]
        if self.chain:
            known = stream[:, self._link_rows[0]]
            lengths = [part.baseline for part in [*self.chain, self._phase]]
            for i in range(1, len(lengths)):
                longer = wrapped if i == len(self.chain) else stream[:, self._link_rows[i]]
                known, integers = resolve(longer, known * lengths[i] / lengths[i - 1])
        else:
            assert prediction is not None
            known, integers = resolve(wrapped, self._predict(stream, prediction, platforms))
        kept[:, self._phase_rows] = known
        return kept, integers

    def _predict(self, stream: Array, prediction: Array, platforms: Array) -> Array:
        """Return the phases at the TDOA fix, at the predicted height."""
        height = vertical(prediction[:, :3])[1]
        place, velocity = prediction[:, :3], prediction[:, 3:6]
        assert self._tdoa is not None
        delays = stream[:, self._tdoa_rows]
        fix = wave_front_fix(self._tdoa, delays, platforms, height, start=place, velocity=velocity)
        target = np.concatenate([fix, np.zeros_like(fix)], axis=-1)
        return self._phase.predict(target, platforms)


class PhaseResolver(EnsembleBlock):
    r"""`PhaseCycles` as a block; the prediction is that of a filter, fed back.

    .. math:: \phi = \phi_w + 2\pi N, \qquad N = \mathrm{round}\frac{\phi_{\mathrm{known}} - \phi_w}{2\pi}

    with :math:`\phi_{\mathrm{known}}` that of the fix, or of the next shorter baseline times the ratio of the lengths.

    Inputs ``measurement``, ``platforms`` and, without a chain, ``prediction``; outputs ``measurement`` (the long
    baseline's phases unambiguous, the chain's rows dropped) and ``integers``.

    Parameters
    ----------
    stream, phase, tdoa, chain
        See `PhaseCycles`.
    trials, platforms : int
        Trials, and number of platforms on the port.
    platform_trials : int
        Trials of the platforms' states.
    states : int
        Components of the prediction, of which the first six are place and velocity.
    name : str
        Name of the block.
    """

    link_names = staticmethod(PhaseCycles.link_names)

    def __init__(
        self,
        stream: Sequence[str],
        phase: InterferometerPhase,
        tdoa: Tdoa | None,
        trials: int,
        platforms: int,
        chain: Sequence[InterferometerPhase] = (),
        platform_trials: int = 1,
        states: int = 6,
        name: str = "phase_resolver",
    ) -> None:
        super().__init__(name)
        self._cycles, self._platforms = PhaseCycles(stream, phase, tdoa, chain, name), platforms
        self.stream = list(self._cycles.stream)
        self.declare_input("measurement", trials, len(stream))
        self.declare_input("platforms", platform_trials, 6 * platforms)
        if not self._cycles.chain:
            self.declare_input("prediction", trials, states)
        inputs = {self.input_port_ticket(self.get_input_port(i).get_index()) for i in range(self.num_input_ports())}
        self._resolved = self.declare_cached("resolved", PhaseResolver._calc, inputs)
        ticket = {self.cached_ticket(self._resolved)}
        self.declare_output(
            "measurement", trials, len(self.stream), lambda c: self.cached(c, self._resolved)[0], ticket
        )
        rows = [(row, "1") for row in phase.names]
        self.declare_output("integers", trials, phase.size, lambda c: self.cached(c, self._resolved)[1], ticket, rows)

    def _calc(self, context: Context) -> tuple[Array, Array]:
        prediction = None if self._cycles.chain else self.read(context, "prediction")
        platforms = self.read(context, "platforms").reshape(-1, self._platforms, 6)
        return self._cycles.cleared(self.read(context, "measurement"), prediction, platforms)
