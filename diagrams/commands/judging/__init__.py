"""The commands that judge: comparisons, sweeps, requirements.

May import: diagrams.assembly, diagrams.chunks, diagrams.console, diagrams.experiments, diagrams.figures,
diagrams.pages, diagrams.scale, diagrams.schema, diagrams.statistics, diagrams.studies, diagrams.tables,
diagrams.verification.
"""
