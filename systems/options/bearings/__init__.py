"""Estimators that locate by bearings alone, with their options."""
