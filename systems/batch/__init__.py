"""Maximum a posteriori over a window of epochs: all its states and pushes of the motion at once.

May import: systems, systems.estimators, systems.filters, systems.measurement, systems.motion, systems.starts.
"""
