"""Parts: each puts one thing on the bus of a diagram under construction; systems are declared with them."""
