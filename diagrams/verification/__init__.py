"""Requirements that hold, fail, or are undecided: what is asked of a system, judged by Monte Carlo trials.

`specification` is the file, `metric` what is measured of each trial, `statistics` the confidence intervals over the
trials, `sequential` the looks and the verdict, `trials` the study that grows, `verify` all together. Nothing is
imported here: pytest loads the plugin of this package in every session.

May import: diagrams.assembly, diagrams.chunks, diagrams.quantities, diagrams.schema, diagrams.statistics,
diagrams.studies, diagrams.tables, systems.
"""
