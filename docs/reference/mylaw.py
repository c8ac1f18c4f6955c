"""A law in Python that the example files name."""


def my_law(t, sample):
    """Compute -0.5 eta for every agent, m/s."""
    return -0.5 * sample.disagreement
