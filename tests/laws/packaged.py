"""A packaged scenario as a diagram with a recorder, without the machinery of studies."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.find import find, systems
from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.commands.catalogue import load_scenario, variants
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw

__all__ = ["EVERYTHING", "Packaged", "squared_error"]

EVERYTHING = [name + (f":{variant}" if variant else "") for name in systems() for variant in (None, *variants(name))]
"""Every packaged scenario."""


class Packaged:
    """A packaged scenario, wired.

    Parameters
    ----------
    name : str
        ``SYSTEM`` or ``SYSTEM:VARIANT``.
    trials : int
        Trials.
    settings : mapping
        What to change in it.
    estimators : list of str, optional
        By default all of the scenario.
    extra : callable, optional
        ``extra(builder, wired)``: adds more blocks, and returns more ports to record by name.
    """

    def __init__(self, name, trials, settings=None, estimators=None, extra=None):
        head, _, variant = name.partition(":")
        self.scenario = load_scenario(head, variant or None, settings=[f"{k}={v}" for k, v in (settings or {}).items()])
        self.names = select_estimators(self.scenario, estimators)
        builder = DiagramBuilder()
        self.wired = find(head).system.build(builder, self.scenario, self.names, trials)
        ports = {
            "truth": self.wired.truth,
            "platforms": self.wired.platforms,
            "measurement": self.wired.measurement,
            **self.wired.signals,
        }
        for estimator, block in self.wired.estimators.items():
            ports |= {f"{estimator}/{port}": block.GetOutputPort(port) for port in ("estimate", "covariance", "nis")}
        if extra is not None:
            ports |= extra(builder, self.wired)
        self.recorder = record(builder, ports, self.wired.clock)
        self.diagram = builder.Build()

    def run(self, seed=0, first_trial=0, end=None):
        """Return times and signals (samples, trials, size)."""
        context = self.diagram.CreateDefaultContext()
        set_draw(self.diagram, context, Draw(seed, first_trial))
        simulator = Simulator(self.diagram, context)
        simulator.Initialize()
        simulator.AdvanceTo(self.wired.duration if end is None else end)
        return self.recorder.result(context)

    def covariance(self, signals, estimator):
        """Return the covariances of an estimator as matrices."""
        n = self.wired.estimators[estimator].motion.size
        return signals[f"{estimator}/covariance"].reshape(*signals[f"{estimator}/estimate"].shape[:2], n, n)

    def platforms(self, signals):
        """Return the carriers' states, shape (samples, 1 or trials, p, 6)."""
        log = signals["platforms"]
        return log.reshape(*log.shape[:2], -1, 6)


def squared_error(signals, estimator):
    """Return the squared position error, shape (samples, trials)."""
    return np.square(signals[f"{estimator}/estimate"][..., :3] - signals["truth"][..., :3]).sum(axis=-1)
