"""What captions and prose say of the paper's SDecGMCA, wherever a result of it is shown."""

from himap.measures.diagnostics import FAILING
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

_FEW = 3  # departures from the text that a caption can list


def of_sdecgmca(method, nside):
    """Which reading of the paper an `SDecGMCA` is, what in it the text does not have, and where it ends.

    Choices on which the text is silent are named where they are not as the letter has them.

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

    def say(name, value):
        return f"{OPTIONS[name].question} ({OPTIONS[name].choices[value]})"

    against, silent = _departures(method, say)
    text = "the paper's text" + (f" but for {_few(against)}" if against else "")
    if silent:
        text += f" and, where it is silent, {', '.join(silent)}"
    end = min(method.lmax, 2 * nside)
    beyond = {
        "cut": f"it ends at ℓ = {end}, and is divided by the whole truth",
        "regularised": f"it goes on beyond ℓ = {end} with its regularised inversion",
        "projection": f"it goes on beyond ℓ = {end} without regularisation",
    }
    return f"SDecGMCA is read as “{method.reading}”: {text}; {beyond[method.beyond]}"


def in_short(method, nside, n_restarts=1):
    """`of_sdecgmca` for under a figure: choices by name, as `OPTIONS` has them, and where it ends.

    Of several restarts, how they are drawn too.
    """
    against, silent = _departures(method, lambda name, value: f"{name} = {value}")
    text = "the text" + (f" but for {_few(against)}" if against else "")
    text += f", with {_few(silent)}" if silent else ""
    goes = "ends at" if method.beyond == "cut" else "goes on beyond"
    said = f"SDecGMCA “{method.reading}”: {text}; {goes} ℓ = {min(method.lmax, 2 * nside)}"
    return said if n_restarts == 1 else f"{said}; {of_restarts(n_restarts)}"


def of_restarts(n):
    """How `n` restarts are drawn, and when one of them failed: a clause."""
    return (
        f"of {n} restarts the median, the 16–84 % band and, thin, each; a restart failed if its mean "
        f"|C/C0 - 1| at 10 < ℓ < 200 is above {100 * FAILING:g} %"
    )


def _departures(method, words):
    """Choices that the text speaks against, and others that differ from the letter, each in words."""
    values = {name: getattr(method, name) for name in OPTIONS}
    against = [name for name, option in OPTIONS.items() if values[name] in option.against]
    others = [name for name in OPTIONS if name not in against and values[name] != READINGS["letter"][name]]
    return [[words(name, values[name]) for name in names] for names in (against, others)]


def _few(choices):
    """One after the other, or how many where a caption cannot list them."""
    return ", ".join(choices) if len(choices) <= _FEW else f"{len(choices)} choices"
