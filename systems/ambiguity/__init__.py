"""The cross-ambiguity function of two receivers: time and frequency difference of arrival from I/Q samples.

May import: systems.iq.
"""
