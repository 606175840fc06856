"""Measurements that come late: what delays them, and estimators that go back to when they were made.

May import: systems, systems.estimators, systems.filters, systems.starts.
"""
