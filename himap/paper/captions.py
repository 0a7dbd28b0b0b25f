"""Descriptions of the paper's SDecGMCA in captions and prose."""

from himap.measures.diagnostics import FAILING
from himap.removal.sdecgmca.readings import OPTIONS, READINGS

_FEW = 3  # departures from the text that a caption can list


def of_sdecgmca(method, nside):
    """State the reading of an `SDecGMCA`, how it departs from the paper's text, and where it ends.

    A sentence without its full stop. Choices on which the text is silent are listed if they differ from the
    letter. `nside` is that of the maps, which represent multipoles well up to 2 nside.
    """

    def say(name, value):
        return f"{OPTIONS[name].question} ({OPTIONS[name].choices[value]})"

    against, silent = _departures(method, say)
    text = "the paper's text" + (f" except for {_few(against)}" if against else "")
    if silent:
        text += f" and, where it is silent, {', '.join(silent)}"
    end = min(method.lmax, 2 * nside)
    beyond = {
        "cut": f"it ends at ℓ = {end} and is compared with the truth at all multipoles",
        "regularised": f"its regularised inversion is continued beyond ℓ = {end}",
        "projection": f"it is continued beyond ℓ = {end} without regularisation",
    }
    return f"SDecGMCA has the reading “{method.reading}”: {text}; {beyond[method.beyond]}"


def in_short(method, nside, n_restarts=1):
    """`of_sdecgmca` for a caption: choices by name, as in `OPTIONS`, and where it ends.

    For several restarts, it also says how they are drawn.
    """
    against, silent = _departures(method, lambda name, value: f"{name} = {value}")
    text = f"the text except for {_few(against)}" if against else "the text"
    text += f", with {_few(silent)}" if silent else ""
    end = "up to" if method.beyond == "cut" else "continued beyond"
    caption = f"SDecGMCA: reading “{method.reading}” ({text}), {end} ℓ = {min(method.lmax, 2 * nside)}"
    if n_restarts == 1:
        return caption
    top = "< 200" if 2 * nside >= 200 else f"≤ {2 * nside}"
    return (
        f"{caption}; median, 16–84 % band and, thin, each of {n_restarts} restarts; a restart fails if its "
        f"mean |C/C0 - 1| at 10 < ℓ {top} exceeds {100 * FAILING:g} %"
    )


def _departures(method, words):
    """Choices that contradict the text, and others that differ from the letter, each in words."""
    values = {name: getattr(method, name) for name in OPTIONS}
    against = [name for name, option in OPTIONS.items() if values[name] in option.against]
    others = [name for name in OPTIONS if name not in against and values[name] != READINGS["letter"][name]]
    return [[words(name, values[name]) for name in names] for names in (against, others)]


def _few(choices):
    """List the choices, or their number if a caption cannot list them."""
    return ", ".join(choices) if len(choices) <= _FEW else f"{len(choices)} choices"
