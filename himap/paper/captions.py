"""What captions and prose say of the paper's SDecGMCA, wherever a result of it is shown."""

from himap.removal.sdecgmca.readings import OPTIONS, READINGS

__all__ = ["of_sdecgmca"]

_FEW = 3  # departures from the text that a caption can list


def of_sdecgmca(method, nside):
    """Which reading of the paper an `SDecGMCA` is, in what it departs from the text, and where it ends.

    Parameters
    ----------
    method
        `SDecGMCA`.
    nside
        Of the maps, which hold multipoles up to 2 nside well.

    Returns
    -------
    str
        A sentence without its full stop.
    """
    letter = READINGS["letter"]
    apart = [OPTIONS[name].question for name in OPTIONS if getattr(method, name) != letter[name]]
    differs = f"the {', '.join(apart)}" if len(apart) <= _FEW else f"{len(apart)} choices"
    text = f"the paper's text but for {differs}" if apart else "every word of the paper's text"
    end = min(method.lmax, 2 * nside)
    beyond = {
        "cut": f"ends at ℓ = {end}, as does the truth that it is divided by",
        "regularised": f"goes on beyond ℓ = {end} with its regularised inversion",
        "projection": f"goes on beyond ℓ = {end} without regularisation",
    }
    return f"SDecGMCA is read as “{method.reading}”, {text}, and {beyond[method.beyond]}"
