"""What a linear filter keeps of HI, from its own covariance of HI and noise: no mocks, and no truth."""

import numpy as np
from scipy import fft

from himap.measures.transfer import CylindricalPower, Recovery


def expected_recovery(found, channel_width):
    """The `Recovery` of HI and noise that has the covariance C_l which a method cleaned with.

    Of the modes n_l of HI and noise the filter W_l G_l leaves n_l - W_l G_l n_l, whose powers are sums over
    C_l: those of mocks without number, of a Gaussian field. The filter is held fixed, as a Wiener filter of
    smooth spectra nearly is. `common` is all that a spectrum of what is left is to be divided by: of the
    foreground as much is left as is missing in `came_back`, if its covariance is the right one.

    Parameters
    ----------
    found
        A `FilteredSeparation`.
    channel_width
        MHz.

    Returns
    -------
    Recovery
        To l = ``found.filter.lmax``; `TransferFunction` makes shares by l and k of it.
    """
    linear, n_channels = found.filter, len(found.mixing)
    waves = fft.rfft(np.eye(n_channels), axis=0)
    rows = []
    for degree, (spectra, estimators) in enumerate(zip(linear.spectra, linear.estimators, strict=True)):
        faint = linear.faint_at(degree)
        keeps = np.eye(n_channels) - spectra @ estimators
        common = keeps @ faint
        rows.append([_power(waves, products) for products in (faint, common @ keeps.T, common)])
    scale = channel_width / n_channels
    put_in, came_back, common = (
        CylindricalPower(power=scale * np.array(power), n_channels=n_channels, channel_width=channel_width)
        for power in zip(*rows, strict=True)
    )
    return Recovery(put_in=put_in, came_back=came_back, common=common)


def _power(waves, products):
    """Power by k of a field of this covariance between channels, (n_k,)."""
    return np.sum((waves @ products) * waves.conj(), axis=1).real
