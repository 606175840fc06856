"""Which satellite was heard: received frequencies against the two-line elements of many."""
