"""How many sources to remove, without the truth: three criteria for a cube, and a number or a range.

Eigenvalues
    Of the channel covariance: HI and noise decline slowly and smoothly with the number of the component,
    foregrounds exceed that line. For a method that uses the beam, the covariance is that of maps at a common
    resolution, that of the worst channel, without the components added by a beam that varies with frequency.
Information criterion
    Bayesian (BIC), for any method: ln of the residual variance, averaged over channels, plus ln(n_pix) /
    n_pix for each free number of the mixing matrix and the sources, divided by the number of channels. It
    decreases as long as a source explains more than it costs.
Stability
    Change of both recovered spectra from one n_s to the next: large while there is foreground residual, then
    small, and slow once signal is lost. It shows if no number is adequate.

With weights and flags, covariance (`himap.removal.weighted_pca.seen_covariance`) and variances are weighted,
only observed voxels count as samples, and spectra have 0 in the gaps.
"""

from dataclasses import dataclass
from itertools import islice

import numpy as np

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.cubes.cleaning import cleaning_of, method_for
from himap.cubes.report import figure, panel, write_page
from himap.cubes.spectra import analysed, scales
from himap.figures import plotting, styles
from himap.figures.tables import Table
from himap.instrument.beams.base import gaussian_widths
from himap.measures.n_sources import STABLE, changes, eigenvalue_line, information, n_significant, settled
from himap.removal import available
from himap.removal.base import REGISTRY
from himap.removal.blurred_mixture import one_resolution_eigenvalues
from himap.removal.covariance import channel_covariance
from himap.removal.weighted_pca import seen_covariance

MOST_SOURCES = 10
"""Default largest number of sources."""


@dataclass(frozen=True, kw_only=True)
class Suggestion:
    """Result of `suggest` for each number of sources.

    Attributes
    ----------
    n_sources
        The tested numbers, (n,).
    eigenvalues, line
        Of the channel covariance, and the extrapolated line of HI and noise, (n_channels,), mK^2.
    n_bright
        Number of eigenvalues above the line.
    criterion
        BIC per pixel and channel, minus its minimum, (n,).
    change
        Largest relative change of C_l (for images P(k_perp, k_par)) and P(k) to the next n_s, averaged over
        scales, (n - 1,).
    stable
        The first number from which the spectra change by less than `STABLE` to the next, or None.
    method
        Its name.
    at_one_resolution
        Whether the eigenvalues are those of maps at a common resolution.
    widths
        Smallest and largest FWHM of the beam assumed by the method, degrees; None if it uses no beam.
    weighted
        Whether the cube has weights or gaps.
    """

    n_sources: np.ndarray
    eigenvalues: np.ndarray
    line: np.ndarray
    n_bright: int
    criterion: np.ndarray
    change: np.ndarray
    stable: int | None
    method: str
    at_one_resolution: bool
    widths: tuple[float, float] | None = None
    weighted: bool = False

    @property
    def best(self):
        """The number that minimises the criterion."""
        return int(self.n_sources[self.criterion.argmin()])

    @property
    def criterion_alone(self):
        """Whether the criterion alone decides: possible only for a method that uses the beam.

        It does if the spectra change by less than `STABLE` with one source more than its minimum, or if the
        eigenvalues are not at a common resolution and include those added by the beam.
        """
        moves = self.change[self.n_sources[:-1] == self.best]
        return self.widths is not None and (not self.at_one_resolution or bool((moves < STABLE).any()))

    @property
    def range(self):
        """(low, high): from the number of the criterion to that of the eigenvalues, or None.

        Both are the former if the criterion decides alone. None if they disagree and no spectrum is stable,
        or if the criterion decreases up to the last tested number and the eigenvalues do not give fewer.
        """
        bright = self.best if self.criterion_alone else self.n_bright
        if self.best == self.n_sources[-1] and bright >= self.best:
            return None
        if self.stable is None and self.best != self.n_bright:
            return None
        views = np.clip([self.best, bright], *self.n_sources[[0, -1]])
        return int(views.min()), int(views.max())


def suggest(cube, method="pca", *, n_sources=None, beams=None, peaks=True, **parameters):
    """Numbers of sources to consider for a cube with this method and beam, without the truth.

    The recommendation is `Suggestion.range`. For a method that uses the beam, eigenvalues of a full sky are
    those of maps at the resolution of the worst channel, to l = 2 nside, and the criterion may decide.

    Parameters
    ----------
    cube
        A `Cube`; with weights or flags for a method that accepts them.
    method
        Name of a method with a number of sources.
    n_sources
        Numbers to test, ascending, at least two; default 1 to 10, or as many as the channels allow.
    beams, peaks
        As in `clean_cube`.
    parameters
        Other parameters of the method.

    Returns
    -------
    Suggestion

    Raises
    ------
    InputError
        A method without sources, numbers that do not ascend, or conditions of the method, such as lines of
        sight with too few channels for the largest number.
    """
    check_method(method)
    n_channels = len(cube.freqs)
    n_sources = range(1, min(MOST_SOURCES + 1, n_channels)) if n_sources is None else n_sources
    several = n_sources if np.iterable(n_sources) else [n_sources]
    # A range may be infinite.
    counts = [whole_number("n_sources", one, 0, n_channels) for one in islice(several, n_channels)]
    in_a_row = len(counts) > 1 and counts == [*range(counts[0], counts[0] + len(counts))]
    if not in_a_row or counts[0] < 1 or counts[-1] >= n_channels:
        is_range = isinstance(n_sources, range)
        given = f"{n_sources.start} to {n_sources.stop - 1}" if is_range else n_sources
        raise InputError(
            "n_sources (--from, --to) are two or more numbers in a row, from 1 to one less than there are "
            f"channels, {n_channels - 1}, got {given}."
        )
    counts = np.array(counts)
    # Fail before the computation.
    remover = method_for(cube, method, beams=beams, n_sources=int(counts[-1]), **parameters)
    cleaning = cleaning_of(cube, remover, beams, peaks=peaks)
    weights = [None] * n_channels if cube.weights is None else np.broadcast_to(cube.weights, cube.maps.shape)
    variances, spectra, near = [], [], None
    for count in progress(counts[::-1], "numbers of sources"):  # from the cube with the least foreground
        cleaned = cleaning.with_sources(int(count))
        near = near or analysed(cube, cleaned.residual)
        pairs = zip(cleaned.residual, weights, strict=True)
        variances.insert(0, [np.cov(channel, aweights=some, ddof=0) for channel, some in pairs])
        spectra.insert(0, scales(cleaned, near))
    change = changes(spectra)
    n_seen = None if cube.missing is None else np.count_nonzero(~cube.missing, axis=1)
    criterion = information(np.array(variances), counts, cube.maps.shape[1], n_seen=n_seen)
    widths = None
    if "beams" in remover.uses:
        fwhm = np.rad2deg(gaussian_widths(beams))
        widths = float(fwhm.min()), float(fwhm.max())
    # The edge of a part of the sky would also exceed the line once maps are re-convolved.
    at_one = widths is not None and cube.whole_sky
    if cube.weights is not None:  # noise in gaps with more sources would exceed the line
        best = cleaning.with_sources(int(counts[criterion.argmin()])).separation
        values = np.linalg.eigvalsh(seen_covariance(cube.maps, cube.weights, best))[::-1]
    elif at_one:
        lmax = min(2 * cube.nside, beams.shape[1] - 1)
        values = one_resolution_eigenvalues(cleaning.basis.modes, beams, lmax)
    else:
        values = np.linalg.eigvalsh(channel_covariance(cube.maps))[::-1]
    return Suggestion(
        n_sources=counts,
        eigenvalues=values,
        line=eigenvalue_line(values),
        n_bright=n_significant(values),
        criterion=criterion,
        change=change,
        stable=settled(change, counts),
        method=method,
        at_one_resolution=at_one,
        widths=widths,
        weighted=cube.weights is not None,
    )


def check_method(method):
    """Refuse the name of a method without a number of sources."""
    counted = [name for name in available() if "n_sources" in REGISTRY[name].__dataclass_fields__]
    if method in REGISTRY and method not in counted:
        raise InputError(f"{method} has no number of sources; {', '.join(counted)} have one.")


def advice(suggestion):
    """The recommendation of a `Suggestion` in words, and the effect of one more source."""
    tried = f"from {suggestion.n_sources[0]} to {suggestion.n_sources[-1]}"
    if suggestion.range is None:
        other = "" if suggestion.widths is not None else ", or a method that knows the beam"
        most = "there are too few channels for more"
        if suggestion.n_sources[-1] < len(suggestion.eigenvalues) - 1:
            most = f"try larger ones{other}"
        why = f"No number {tried} keeps both spectra unchanged with one more source"
        if suggestion.best == suggestion.n_sources[-1]:
            why = f"The criterion still falls at {suggestion.best}, the last tested number"
        return f"{why}: {most}."
    low, high = suggestion.range
    if low < high:
        numbers = f"{low} to {high}, and look at the page of each"
    elif low == suggestion.n_sources[0] > max(suggestion.n_bright, 1):
        numbers = f"{low}, the smallest tested number: try smaller ones"
    elif not suggestion.n_bright:
        numbers = f"{low}, if any: no eigenvalue exceeds HI and noise"
    elif suggestion.criterion_alone and low != suggestion.n_bright:
        numbers = f"{low}, by the residual of this method"
    else:
        numbers = f"{low}, by both criteria"
    method, only = suggestion.method, "this method alone: run it again for a beam-aware method"
    if suggestion.widths is not None:
        least, most = suggestion.widths
        method = f"{method} with a beam of {least:.3g} to {most:.3g} deg FWHM"
        only = "this method and beam alone: run it again for others"
    sentences = [f"For {method}, consider n_sources = {numbers}."]
    if suggestion.best == suggestion.n_sources[-1]:
        sentences.append(f"The criterion still falls at {suggestion.best}, the last tested number.")
    if not suggestion.criterion_alone and suggestion.n_bright > suggestion.n_sources[-1]:
        sentences.append(f"{suggestion.n_bright} eigenvalues exceed HI and noise: try larger ones too.")
    last = np.flatnonzero(suggestion.n_sources == high)[0]
    if last < len(suggestion.change):
        more = f"{suggestion.change[last]:.1%} in the mean over its scales"
        sentences.append(f"One more than {high} changes a spectrum by {more}.")
    if suggestion.stable is None:
        sentences.append(
            f"No number {tried} keeps both spectra unchanged with one more source: each source removes HI, "
            "the more the fewer channels there are. Mocks measure how much (`himap transfer`)."
        )
    return " ".join([*sentences, f"It is for {only}."])


def suggestion_table(suggestion):
    """A `Table` with a row for each number of sources."""
    changes_to_next = [*(f"{change:.1%}" for change in suggestion.change), ""]
    criteria = [f"{value:.4f}" for value in suggestion.criterion]
    rows = zip(suggestion.n_sources, criteria, changes_to_next, strict=True)
    return Table(["n_sources", "criterion", "change with one more"], rows)


def views_figure(suggestion):
    """Figure of the three criteria of a `Suggestion`."""
    number, counts = np.arange(1, len(suggestion.eigenvalues) + 1), suggestion.n_sources
    blue, orange = {"color": styles.BLUE, "marker": "o"}, {"color": styles.VERMILION}
    dashed = {"color": "black", "linestyle": "--"}
    eigenvalues = [
        (number, suggestion.eigenvalues, orange | {"label": "of the cube"}),
        (number, suggestion.line, dashed | {"label": "HI and noise"}),
    ]
    title = "Eigenvalues" + " at one resolution" * suggestion.at_one_resolution
    panels = [
        panel("eigenvalues", eigenvalues, title=title),
        {
            "title": "Information criterion",
            "xlabel": "number of sources",
            "ylabel": "BIC per voxel minus its minimum",
            "yscale": "symlog",
            "curves": [(counts, suggestion.criterion, blue)],
        },
        {
            "title": "Change of the spectra with one more",
            "xlabel": "number of sources",
            "ylabel": "mean relative change",
            "yscale": "log",
            "curves": [(counts[:-1], suggestion.change, blue), (counts[[0, -2]], [STABLE] * 2, dashed)],
        },
    ]
    return plotting.lines(panels, columns=3, size=(4, 3.4))


def write_suggestion(suggestion, path, *, said=()):
    """Write a page with the three criteria of a `Suggestion`, and sentences on what was assumed."""
    text = (
        "Foregrounds exceed the line. The criterion decreases as long as a source explains more than it "
        f"costs. Spectra that change by less than {100 * STABLE:g} % with one more source, below the dashed "
        "line, do not depend on the choice."
    )
    if suggestion.weighted:
        text += (
            " Covariance and variances are weighted, only observed voxels count as samples, and "
            "spectra have 0 in the gaps."
        )
    picture = figure(views_figure(suggestion), "Three criteria", text)
    write_page(path, "How many sources?", [f"<p>{advice(suggestion)}</p>", picture], said=said)
