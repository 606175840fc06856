"""Errors, consistency, bounds, intervals: numbers from results, and the blocks and recursions that make them."""
