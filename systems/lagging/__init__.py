"""What an estimator knows some time later, while the run goes on.

May import: systems, systems.estimators, systems.smoothing.
"""
