"""Smoothers in a study: what looks back on the logs of a run.

May import: diagrams.assembly, diagrams.quantities, diagrams.statistics, systems, systems.estimators.
"""
