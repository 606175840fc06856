"""Compiled numerical kernels (numba): the equations of the models for one state, and the loops over trials around them.

Other rooms import `equations`, `updating`, `loading` and `progress`; what imports numba, which takes most of a second,
is loaded by `quietfix.systems.kernels.loading` when it is first needed.

May import: nothing of ours.
"""
