"""The methods and beams as the paper uses them (its Table 1 and Sects. 2.2.1 and 4)."""

from himap.core.checks import with_fields
from himap.core.errors import InputError
from himap.core.registry import plain_name
from himap.instrument.beams import named
from himap.instrument.beams.paper import Degraded, Evolving, Oscillating
from himap.removal import GMCA, PCA, BeamSubspace, FastICA, Parametric, Polynomial, SDecGMCA

TABLE_1 = {
    "degraded": {"n_sources": 3, "regularisation": 1e-3, "share": 0.3},
    "evolving": {"n_sources": 4, "regularisation": 5e-3, "share": 0.8},
    "oscillating": {"n_sources": 5, "regularisation": 1e-2, "share": 0.7},
}
"""Parameters of the paper by beam (Table 1): n_s, c and K_max."""

BSS = ("pca", "fastica", "gmca", "sdecgmca")
"""The methods of blind source separation; the others are fits along lines of sight."""


def paper_beams(*, ripple="bracket"):
    """The three beams of the paper, {name: `Beam`}; `ripple` is the reading of the oscillating one."""
    beams = Degraded(), Evolving(), Oscillating(ripple=ripple)
    return {beam.name: beam for beam in beams}


def beam_called(name, *, ripple="bracket", others=()):
    """The `Beam` of a name or file, as in `himap.instrument.beams.named`, with that reading of the ripple.

    InputError for a reading that neither this beam nor, if there are several, one of the `others` has.
    """
    found = paper_beams(ripple=ripple).get(plain_name(name)) or named(name)
    if ripple != Oscillating().ripple and Oscillating.name not in map(plain_name, (found.name, *others)):
        raise InputError(f"ripple is a reading of the oscillating beam, and {found} has none: leave it out.")
    return found


def table_1(beam):
    """The row of `TABLE_1` for a `Beam`; a beam that is not in the paper gets that of the oscillating one."""
    return TABLE_1.get(beam.name, TABLE_1["oscillating"])


BEAM_AWARE = {
    SDecGMCA.name: (SDecGMCA, ("n_sources", "regularisation", "share")),
    BeamSubspace.name: (BeamSubspace, ("n_sources",)),
}
"""Methods that can replace SDecGMCA, {name: (class, parameters that they take from Table 1)}."""


def beam_aware_for(beam, method="sdecgmca", **options):
    """The method of `BEAM_AWARE` called `method`, with the parameters of Table 1 for a beam, except for
    `options`; InputError for another method, an unknown option, or an invalid value.
    """
    if method not in BEAM_AWARE:
        raise InputError(f"SDecGMCA can be replaced by {', '.join(BEAM_AWARE)}, got {method!r}.")
    kind, columns = BEAM_AWARE[method]
    row = table_1(beam)
    return with_fields(kind, {name: row[name] for name in columns} | options)


def sdecgmca_for(beam, **changed):
    """SDecGMCA with the parameters of Table 1 for a beam, except for `changed`, as in `beam_aware_for`."""
    return beam_aware_for(beam, **changed)


def check_reading(reading, methods):
    """Raise InputError for a reading of SDecGMCA, other than the default, if none of the methods has it."""
    if reading != SDecGMCA().reading and not any(isinstance(one, SDecGMCA) for one in methods):
        raise InputError(f"the reading {reading!r} is of SDecGMCA, which is not among the methods.")


def methods_for(beam, n_sources=None, *, method="sdecgmca", variable="temperature", **options):
    """The six methods as the paper uses them for one beam, in the order of `BSS` and then the two fits.

    Parameters
    ----------
    beam
        A `Beam`.
    n_sources
        The number of sources; default: that of Table 1.
    variable
        Variable of the polynomial, as in `Polynomial`.
    method, options
        As in `beam_aware_for`, including its errors: the replacement of SDecGMCA, and its options that
        differ from the defaults.
    """
    n = table_1(beam)["n_sources"] if n_sources is None else n_sources
    return [
        PCA(n_sources=n),
        FastICA(n_sources=n),
        GMCA(n_sources=n),
        beam_aware_for(beam, method, **{"n_sources": n} | options),
        Polynomial(variable=variable),
        Parametric(),
    ]
