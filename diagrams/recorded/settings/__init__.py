"""What may be set of a recording, and what is made of its data before they enter a diagram."""
