"""Plants: the blocks that produce truth."""
