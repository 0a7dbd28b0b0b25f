"""Readings of the paper's SDecGMCA: choices that its text leaves open, by name, and sets of them.

`OPTIONS` are the choices, and `READINGS` are the sets. The letter contradicts no word of the text, and is the
usual choice where the text says nothing. The code has the steps of the public code of Carloni Gertosio &
Bobin (2021, C21); code-rounding is the same with the eigenvalues of the last S floored at rounding. The
follow-up changes the inversion to that of the later code of the paper's first author. Instrument-noise is the
letter with the noise of the instrument in the thresholds. The default, the letter continued beyond lmax
by least squares, is the reading under which most of the paper's statements on SDecGMCA hold, by a rule
(chapter 16).
"""

from dataclasses import dataclass

from himap.core.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Option:
    """One choice that the paper's text leaves open, or makes.

    Attributes
    ----------
    question
        The question to decide.
    choices
        {value: what it means}.
    word
        What the paper says about it, quoted or summarised.
    against
        The values that this contradicts.
    """

    question: str
    choices: dict
    word: str
    against: tuple = ()


OPTIONS = {
    "mixing_scales": Option(
        question="what A is fitted to",
        choices={"detail": "the detail scales of data and sources", "all": "all multipoles of both"},
        word="Sect. 3.3 (iv): a least squares “over all spherical harmonics”",
        against=("detail",),
    ),
    "sign": Option(
        question="sign of A",
        choices={"free": "as it comes", "nonnegative": "negative entries set to zero"},
        word="Sect. 3.3 (iv): “negative entries are set to zero”",
        against=("free",),
    ),
    "coefficients": Option(
        question="epsilon in the refinement",
        choices={"spectrum": "from the spectra of the sources (#4)", "matrix": "from A and the beams (#3)"},
        word="Sect. 3.3: “for the refinement phase, we use Strategy #4”",
        against=("matrix",),
    ),
    "thresholds": Option(
        question="noise of the thresholds",
        choices={
            "mad": "median absolute deviation of each scale",
            "analytic": "that of the instrument, carried through the inversion",
        },
        word="not said; for the levels Sect. 3.3 (v) names Table 1 of C21",
    ),
    "least_kept": Option(
        question="fewest coefficients that a scale of a source keeps",
        choices={5: "five", 0: "none"},
        word="Sect. 3.3 (iii): the active support grows “from 0”",
        against=(5,),
    ),
    "reweighted": Option(
        question="lower thresholds of large coefficients (l1 reweighting) in the refinement",
        choices={True: "yes, with a memory that starts empty", False: "no"},
        word="Sect. 3.3 (iii): “an l1 reweighting step is applied”",
        against=(False,),
    ),
    "wavelets": Option(
        question="low-pass filters of the starlets",
        choices={
            "cascade": "those of the starlet transform, one after the other",
            "ratio": "the ratio of two that follow each other, each on the map itself",
        },
        word="Sect. 3.3 (iii): “isotropic undecimated wavelet (starlet) basis”",
        against=("ratio",),
    ),
    "floor": Option(
        question="smallest eigenvalue of the normal equations, relative to the largest",
        choices={1e-9: "1e-9", 1e-14: "rounding"},
        word="not said",
    ),
    "last_floor": Option(
        question="the same in the last S",
        choices={1e-9: "1e-9", 1e-14: "rounding"},
        word="not said",
    ),
    "resolution": Option(
        question="what H is",
        choices={"beam": "the beam", "best": "the beam relative to that of the best channel"},
        word="Sect. 3.3: H is “the beam transfer function”",
        against=("best",),
    ),
    "start_channel": Option(
        question="channel to whose resolution the data of the first A are brought",
        choices={
            "lowest": "that of the widest beam, found at every l",
            "first": "the first one, each coefficient with m > 0 counted once",
        },
        word="Sect. 3.3 (i): “the lowest-resolution channel”, which is the first of the paper's beams",
    ),
    "last": Option(
        question="the last S",
        choices={
            "once": "Eq. 23 once, with epsilon from the last iteration's sources",
            "repeated": "Eq. 23 with #3, then with epsilon from its own S until that settles",
            "thresholded": "the same with thresholds",
            "unregularised": "least squares without epsilon",
        },
        word="Eq. 23: S with its epsilon; how often, and whether with thresholds, is not said",
        against=("unregularised",),
    ),
    "last_coefficients": Option(
        question="epsilon of the last S",
        choices={"spectrum": "from the spectra of the sources (#4)", "matrix": "from A and the beams (#3)"},
        word="not said",
    ),
    "beyond": Option(
        question="foreground beyond lmax",
        choices={
            "cut": "none is estimated: the residual ends at lmax",
            "regularised": "the regularised inversion carried on to l = 3 nside",
            "projection": "least squares without epsilon",
        },
        word="Sect. 3.3: “restricted to l <= 200”; of what P(k) holds beyond nothing is said",
        against=("regularised", "projection"),
    ),
}
"""{field of `SDecGMCA`: `Option`}."""

_CODE = {
    "mixing_scales": "detail",
    "sign": "free",
    "coefficients": "spectrum",
    "thresholds": "mad",
    "least_kept": 5,
    "reweighted": True,
    "wavelets": "ratio",
    "floor": 1e-9,
    "last_floor": 1e-9,
    "resolution": "best",
    "start_channel": "first",
    "last": "repeated",
    "last_coefficients": "spectrum",
    "beyond": "cut",
    "last_tolerance": 1e-4,
}

_LETTER = _CODE | {
    "mixing_scales": "all",
    "sign": "nonnegative",
    "least_kept": 0,
    "wavelets": "cascade",
    "floor": 1e-14,
    "last_floor": 1e-14,
    "resolution": "beam",
    "start_channel": "lowest",
    "last": "once",
}

READINGS = {
    "default": _LETTER | {"beyond": "projection"},
    "letter": _LETTER,
    "code": _CODE,
    "code-rounding": _CODE | {"last_floor": 1e-14},
    "follow-up": _CODE
    | {"coefficients": "matrix", "resolution": "beam", "beyond": "regularised", "last_tolerance": 1e-6},
    "instrument-noise": _LETTER | {"thresholds": "analytic"},
}
"""{name: {field of `SDecGMCA`: value}}."""


def resolved(reading, given):
    """Return `given` {field: value or None} with None replaced by the value of `reading`.

    Raises
    ------
    InputError
        If there is no such reading, or if options exclude each other.
    """
    if reading not in READINGS:
        raise InputError(
            f"reading must be one of {', '.join(READINGS)}, got {reading!r}; see the chapter on readings."
        )
    options = {name: READINGS[reading][name] if value is None else value for name, value in given.items()}
    if options["beyond"] == "regularised" and options["last"] in ("unregularised", "thresholded"):
        raise InputError(
            f"beyond='regularised' carries the regularised last S on, and last={options['last']!r} has none; "
            "take last='once' or 'repeated', or beyond='projection' or 'cut'."
        )
    return options
