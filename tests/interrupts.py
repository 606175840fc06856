"""Processes that a test interrupts."""

import signal


def listening():
    """Make a child hear Ctrl-C, as ``preexec_fn``: a shell that starts the tests in the background has it ignore that."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
