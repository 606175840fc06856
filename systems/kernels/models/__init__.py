"""The equations of the packaged measurement and motion models for one state, as kernels of the one signature.

A kernel writes what it measures, and where the derivative is asked for (it has rows) that; the derivative comes filled
with zeros. Its parameters are the model's: each says in which order.

May import: systems.kernels, systems.
"""
