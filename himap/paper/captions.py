"""What captions and prose say of the paper's SDecGMCA, wherever a result of it is shown."""

from himap.removal.sdecgmca.readings import OPTIONS, READINGS

__all__ = ["of_sdecgmca"]

_FEW = 3  # departures from the text that a caption can list


def of_sdecgmca(method, nside):
    """Which reading of the paper an `SDecGMCA` is, in what it departs from the text, and where it ends.

    Choices on which the text is silent are named where they are not those of the letter.

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
    apart = [option for name, option in OPTIONS.items() if getattr(method, name) != letter[name]]
    against = [option.question for option in apart if option.said]
    silent = [option.question for option in apart if not option.said]
    differs = f"the {', '.join(against)}" if len(against) <= _FEW else f"{len(against)} choices"
    text = f"the paper's text but for {differs}" if against else "every word of the paper's text"
    if silent:
        text += f" (which does not say the {', '.join(silent)})"
    end = min(method.lmax, 2 * nside)
    beyond = {
        "cut": f"ends at ℓ = {end}, as does the truth that it is divided by",
        "regularised": f"goes on beyond ℓ = {end} with its regularised inversion",
        "projection": f"goes on beyond ℓ = {end} without regularisation",
    }
    return f"SDecGMCA is read as “{method.reading}”, {text}, and {beyond[method.beyond]}"
