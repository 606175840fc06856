"""Blocks from an emitter's samples to TDOA and FDOA: transmitter, receiver, link, cross-ambiguity function."""
