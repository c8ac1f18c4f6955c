"""The sampled law as a linear loop: with its terms, over its links, on the vehicles, and for the targets."""
