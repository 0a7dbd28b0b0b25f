"""What is measured on a cleaned cube, from the cube itself: the slow twin of what follows from its error."""

import numpy as np


def line_errors(recovered, true):
    """Mean squared error of every line of sight of two cubes less their channel means, (n_pix,), mK^2."""
    error = recovered.astype(float) - true
    return np.mean((error - error.mean(axis=1, keepdims=True)) ** 2, axis=0)


def correlation(recovered, true):
    """Pearson r of recovered and true map in every channel, (n_channels,)."""
    return np.array([np.corrcoef(one, two)[0, 1] for one, two in zip(recovered, true, strict=True)])
