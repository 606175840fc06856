"""Recordings of KiwiSDR receivers: which files there are, and where their receivers stand."""
