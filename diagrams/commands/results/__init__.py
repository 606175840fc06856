"""The commands that work with a finished result: its trials, its figures, what tells two apart, other formats.

May import: diagrams.assembly, diagrams.chunks, diagrams.cloud, diagrams.console, diagrams.experiments,
diagrams.figures, diagrams.quantities, diagrams.schema, diagrams.statistics, diagrams.studies, diagrams.writers.
"""
