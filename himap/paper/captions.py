"""What captions and prose say of the paper's SDecGMCA, wherever a result of it is shown."""

from himap.removal.sdecgmca.readings import OPTIONS, READINGS

_FEW = 3  # departures from the text that a caption can list


def of_sdecgmca(method, nside):
    """Which reading of the paper an `SDecGMCA` is, what in it the text does not have, and where it ends.

    What the text is silent on is named where it is not as the letter has it.

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
    values, against, silent = _departures(method)
    text = "the paper's text"
    if against:
        text += (
            f" but for {len(against)} choices"
            if len(against) > _FEW
            else f" but for {_said(values, against)}"
        )
    if silent:
        text += f" and, where it is silent, {_said(values, silent)}"
    end = _end(method, nside)
    beyond = {
        "cut": f"it ends at ℓ = {end}, as does the truth that it is divided by",
        "regularised": f"it goes on beyond ℓ = {end} with its regularised inversion",
        "projection": f"it goes on beyond ℓ = {end} without regularisation",
    }
    return f"SDecGMCA is read as “{method.reading}”: {text}; {beyond[method.beyond]}"


def in_short(method, nside):
    """The same for under a figure: choices by name, as `OPTIONS` has them, and where it ends; no full stop.

    Parameters
    ----------
    method, nside
        As in `of_sdecgmca`.
    """
    values, against, silent = _departures(method)
    off, own = _named(values, against), _named(values, silent)
    text = "the text" + (f" but for {off}" if off else "") + (f", with {own}" if own else "")
    goes = "ends at" if method.beyond == "cut" else "goes on beyond"
    return f"SDecGMCA “{method.reading}”: {text}; {goes} ℓ = {_end(method, nside)}"


def _departures(method):
    """Values of all options, names of those that the text speaks against, and of those it is silent on that
    are not as the letter has them.
    """
    values = {name: getattr(method, name) for name in OPTIONS}
    against = [name for name, option in OPTIONS.items() if values[name] in option.against]
    letter = READINGS["letter"]
    return values, against, [name for name in OPTIONS if name not in against and values[name] != letter[name]]


def _end(method, nside):
    """The last multipole that the inversion and the maps hold."""
    return min(method.lmax, 2 * nside)


def _named(values, names):
    """Choices by name and value, or how many where a caption cannot list them; empty for none."""
    if len(names) > _FEW:
        return f"{len(names)} choices"
    return ", ".join(f"{name} = {values[name]}" for name in names)


def _said(values, names):
    """What is decided and how, one after the other."""
    return ", ".join(f"{OPTIONS[name].question} ({OPTIONS[name].choices[values[name]]})" for name in names)
