"""Cosine needlets: windows over multipoles whose squares add up to one."""

import numpy as np


def cosine_needlets(peaks, lmax):
    """Windows h_j(l) of cosine needlets, (n_peaks, lmax + 1).

    h_j rises from 0 at the peak before to 1 at its own and falls to 0 at the next, as the quarters of a sine
    and a cosine in l, so that sum_j h_j^2 = 1: what is filtered twice adds up to what it was (Basak &
    Delabrouille 2012). The first is 1 below its peak, the last beyond.

    Parameters
    ----------
    peaks
        l of the peaks, ascending.
    """
    degree = np.arange(lmax + 1)
    place = np.interp(degree, peaks, np.arange(len(peaks)))
    distance = np.abs(place - np.arange(len(peaks))[:, None])
    return np.cos(0.5 * np.pi * np.minimum(distance, 1))
