"""A gentle slope with a cliff, with and without noise."""

import numpy as np


def cliff(size=40, height=10.0):
    """The truth (size, size), and the same with noise of 1."""
    truth = np.add.outer(0.05 * np.arange(size), height * (np.arange(size) > size // 2))
    return truth, truth + np.random.default_rng(1).normal(size=(size, size))
