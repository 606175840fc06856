"""Particle filters: pure functions over trials and particles."""
