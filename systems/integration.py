"""Simulators of diagrams that may hold blocks with continuous states."""

from __future__ import annotations

from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Context, Diagram

__all__ = ["LONGEST_STEP", "simulator_of"]

LONGEST_STEP = 0.1
"""Of the integration of continuous states, unless it is said otherwise [s]."""


def simulator_of(diagram: Diagram, context: Context | None = None, step: float = LONGEST_STEP) -> Simulator:
    """Return a simulator whose integrator, where there is anything to integrate, has a fixed step.

    Runge-Kutta of order 5. Error control would choose the step by all trials together, so that the numbers of a trial
    depended on its neighbours; and with a NaN in the state it never ends.

    Parameters
    ----------
    diagram : Diagram
    context : Context, optional
        By default a new one.
    step : float
        The longest step [s]; shorter ones end at events.
    """
    simulator = Simulator(diagram) if context is None else Simulator(diagram, context)
    if simulator.get_context().num_continuous_states():
        ResetIntegratorFromFlags(simulator, "runge_kutta5", step)
        simulator.get_mutable_integrator().set_fixed_step_mode(True)
    return simulator
