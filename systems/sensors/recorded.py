"""Recorded measurements in the place of a simulated sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Times
from quietfix.systems.playback.tracks import Tracked

__all__ = ["RecordedMeasurements", "Recording"]

Array = NDArray[np.float64]


class Recording:
    """What was measured of one target.

    Parameters
    ----------
    times : array_like, shape (samples,)
        Strictly increasing, >= 0 [s].
    measurement : array_like, shape (samples, rows) or (samples, trials, rows)
        NaN where a row is missing.
    platforms : array_like, shape (p, 6), (samples, p, 6) or (samples, 1 or trials, p, 6)
        Earth-fixed states of the platforms: standing still, or at each sample (they may be different ones each
        time); NaN where a platform is missing.
    noise_covariance : array_like, shape (samples, rows, rows) or (samples, trials, rows, rows), optional
        R of each sample, where it comes with the measurement.

    Attributes
    ----------
    times, measurement, platforms, noise_covariance : ndarray
        The same with all axes: (samples,), (samples, trials, rows), (samples, 1 or trials, p, 6),
        (samples, trials, rows, rows) or None.
    clock : Times
        The samples as a clock.

    Raises
    ------
    ValueError
        For shapes that do not fit each other, or times that do not increase.
    """

    def __init__(
        self,
        times: ArrayLike,
        measurement: ArrayLike,
        platforms: ArrayLike,
        noise_covariance: ArrayLike | None = None,
    ) -> None:
        self.clock = Times(times)
        self.times = self.clock.ticks(np.inf)
        samples = self.times.size
        self.measurement = np.array(measurement, dtype=float)
        if self.measurement.ndim == 2:
            self.measurement = self.measurement[:, None]
        if self.measurement.ndim != 3 or self.measurement.shape[0] != samples or self.measurement.shape[2] == 0:
            raise ValueError(
                f"recording: measurement {np.shape(measurement)} is not allowed; ({samples}, rows) or "
                f"({samples}, trials, rows)"
            )
        trials, rows = self.measurement.shape[1:]

        states = np.array(platforms, dtype=float)
        if states.ndim == 2:
            states = np.broadcast_to(states, (samples, *states.shape))
        self.platforms = states[:, None] if states.ndim == 3 else states
        shape = self.platforms.shape
        if len(shape) != 4 or shape[0] != samples or shape[1] not in (1, trials) or shape[3] != 6:
            raise ValueError(
                f"recording: platforms {np.shape(platforms)} is not allowed; (p, 6), ({samples}, p, 6) or "
                f"({samples}, 1 or {trials}, p, 6)"
            )

        self.noise_covariance: Array | None = None
        if noise_covariance is not None:
            noise = np.array(noise_covariance, dtype=float)
            if noise.ndim == 3:
                noise = np.broadcast_to(noise[:, None], (samples, trials, *noise.shape[1:]))
            if noise.shape != (samples, trials, rows, rows):
                raise ValueError(
                    f"recording: noise_covariance {np.shape(noise_covariance)} is not allowed; "
                    f"({samples}, {rows}, {rows}) or ({samples}, {trials}, {rows}, {rows})"
                )
            self.noise_covariance = noise

    def shifted(self, later: float) -> Recording:
        """Return the same, so many seconds later."""
        return Recording(self.times + later, self.measurement, self.platforms, self.noise_covariance)

    @property
    def layout(self) -> tuple[int, int, int, int, bool]:
        """Trials, rows, trials of the platforms, platforms, and whether R comes with the measurement."""
        _, trials, rows = self.measurement.shape
        return trials, rows, self.platforms.shape[1], self.platforms.shape[2], self.noise_covariance is not None


class RecordedMeasurements(Tracked):
    """All recordings of a data set behind the ports of a sensor; a run plays one of them.

    Outputs ``measurement`` and ``platforms``, and ``noise_covariance`` where the recordings have one; NaN between
    the samples of the recording that plays. The ticks of all recordings are declared, and a parameter of the
    context says which recording plays: one built diagram serves all of them, each in a context of its own.

    Parameters
    ----------
    recordings : sequence of Recording
        They share rows, trials and number of platforms.
    name : str
        Name of the block.

    Attributes
    ----------
    clock : Times
        The samples of all recordings together: the clock of everything that reads this block.

    Raises
    ------
    ValueError
        If there are no recordings, or they differ in layout.

    Examples
    --------
    ::

        context = diagram.CreateDefaultContext()
        end = recorded.select(context, 7)
        simulator = Simulator(diagram, context)
        simulator.Initialize()
        simulator.AdvanceTo(end)
    """

    def __init__(self, recordings: Sequence[Recording], name: str = "recorded") -> None:
        if not recordings:
            raise ValueError(f"{name}: no recordings; at least one is needed")
        layouts = {recording.layout for recording in recordings}
        if len(layouts) > 1:
            raise ValueError(
                f"{name}: recordings must agree in (trials, rows, trials of platforms, platforms, R given), "
                f"there are {sorted(layouts)}"
            )
        super().__init__(name, [recording.clock for recording in recordings])
        self.recordings = list(recordings)
        self.trials, self.rows, self.platform_trials, self.platforms, noisy = layouts.pop()
        self._serve("measurement", self.trials, self.rows)
        self._serve("platforms", self.platform_trials, 6 * self.platforms)
        if noisy:
            self._serve("noise_covariance", self.trials, self.rows**2)

    def _serve(self, name: str, trials: int, size: int) -> None:
        gap = np.full(trials * size, np.nan)
        values: list[Array] = [getattr(r, name).reshape(r.times.size, -1) for r in self.recordings]

        def value(context: Context) -> Array:
            track, sample = self.playing(context)
            return gap if sample is None else values[track][sample]

        self.declare_output(name, trials, size, value, self.track_tickets)
