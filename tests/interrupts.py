"""Processes that a test interrupts."""

import signal


def listening():
    """Make a child hear Ctrl-C, as ``preexec_fn``: begun in the background it would ignore that, as its parents do."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
