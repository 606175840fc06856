"""The golden record: what every packaged system gives, to the last bit; ``python -m tests.golden`` writes it anew."""
