"""Quietfix building blocks: pure models and filters, and the Drake blocks around them.

Sub-packages ``motion``, ``measurement`` and ``filters`` are plain NumPy and know nothing of Drake;
``plants``, ``sensors`` and ``estimators`` are thin LeafSystems that call them.
"""
