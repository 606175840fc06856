"""How an estimator starts: from a belief, from a port, from its first measurement."""
