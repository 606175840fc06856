"""What the scenarios of the packaged systems say."""
