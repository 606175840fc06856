"""Parts that one packaged system needs alone."""
