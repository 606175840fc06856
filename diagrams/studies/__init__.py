"""A study: a system run over trials, its result as a dataset, and the folder that it is written to.

May import: diagrams.assembly, diagrams.chunks, diagrams.console, diagrams.quantities, diagrams.readers,
diagrams.schema, diagrams.smoothing, diagrams.statistics, diagrams.writers, systems, systems.estimators,
systems.kernels, systems.playback.
"""
