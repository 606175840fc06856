"""What may stand under ``estimators:``; a new one is its file here and a line in `quietfix.systems.registry`.

May import: systems, systems.batch, systems.estimators, systems.filters, systems.measurement, systems.motion,
systems.smoothing, systems.starts.
"""
