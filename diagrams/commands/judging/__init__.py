"""The commands that judge: comparisons, sweeps, requirements.

May import: diagrams.assembly, diagrams.console, diagrams.experiments, diagrams.figures, diagrams.schema,
diagrams.statistics, diagrams.studies, diagrams.tables, diagrams.verification.
"""
