"""A study: a system run over trials, its result as a dataset, and the folder that it is written to."""
