"""What every method of foreground removal has in common: checks, centring, subtraction, the register.

A method is a frozen dataclass of its parameters with one hook, `_separate`. To add one, write one file with
one class in `himap/removal/`; it registers by its name, and the contract test runs on it by itself.
"""

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from himap.checks import checked_beams, checked_fields, checked_freqs, checked_noise, parameter
from himap.errors import InputError
from himap.maps.blocked import centred, lean
from himap.removal.seen import Seen, means_of
from himap.removal.separation import Cleaned, Separation, modes_of
from himap.removal.weights import check_lines

__all__ = ["REGISTRY", "Cleaned", "ForegroundRemover", "Separation", "SeparationWarning", "parameter"]

REGISTRY = {}


class SeparationWarning(UserWarning):
    """A method ended without converging, or with something the user should know."""


@dataclass(frozen=True, kw_only=True)
class ForegroundRemover(ABC):
    """A method of foreground removal; its fields are its parameters.

    Attributes
    ----------
    name
        What it is called in `removal.create`, in file names and in figures.
    centred
        Whether `_separate` gets maps less their channel means. A method that is not linear in the maps, such
        as a fit of power laws, sets it to False and gives the whole foreground.
    needs_beams
        Whether the method uses the beams; the others get None for them.
    needs_noise
        Whether the method uses the noise of the instrument.
    needs_whole_sky
        Whether the pixels must be a whole HEALPix sphere; the others take any lines of sight.
    takes_image
        Whether a method that needs the whole sky takes an image in the plane too, or a part of it: then
        `_separate` gets the lines of sight that are kept, and their places as `image`, (n_y, n_x) bool.
    ends_by_count
        Whether the method as published also ends after so many iterations, settled or not; then to have come
        to that end is recorded (`Separation.converged`), and no warning.
    needs_modes
        Whether `_separate` gets the harmonic modes of the maps too, `modes`, a `CubeModes`.
    takes_mask
        Whether `_separate`, where there is a mask, gets it as `kept`. A method that needs the whole sky then
        gets maps that go on outside of the mask, and should learn nothing from there; one that does not take
        the mask learns from all of them. The others get the lines of sight that are kept.
    takes_weights
        Whether `_separate`, where weights differ, gets them as `weights`, (n_pix,) or (n_channels, n_pix), of
        the lines of sight that are kept; where these are 0, maps are finite. The others refuse them.
    """

    name: ClassVar[str]
    centred: ClassVar[bool] = True
    needs_beams: ClassVar[bool] = False
    needs_noise: ClassVar[bool] = False
    needs_whole_sky: ClassVar[bool] = False
    takes_image: ClassVar[bool] = False
    needs_modes: ClassVar[bool] = False
    takes_mask: ClassVar[bool] = False
    takes_weights: ClassVar[bool] = False
    ends_by_count: ClassVar[bool] = False

    @classmethod
    def needs_sphere(cls):
        """Whether the method refuses images in the plane."""
        return cls.needs_whole_sky and not cls.takes_image

    @property
    def ends(self):
        """Whether what is left ends at some multipole (`Separation.lmax`)."""
        return False

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        REGISTRY[cls.name] = cls

    def __post_init__(self):
        checked_fields(self)

    def clean(
        self,
        maps,
        *,
        freqs,
        beams=None,
        noise=None,
        rng=None,
        separate_on=None,
        modes=None,
        mask=None,
        weights=None,
        image=None,
    ):
        """Find the foreground and subtract it.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; left as they are.
        freqs, beams, noise, rng
            As in `separate`.
        separate_on
            Maps of the same shape to find the foreground in, such as `maps` with their peaks masked; `maps`
            themselves unless given. The foreground is always subtracted from `maps`.
        modes
            As in `separate`, of those maps.
        mask
            As in `separate`; the residual is 0 where nothing is kept.
        weights
            As in `separate`; the residual is 0 where a voxel is missing, and the foreground what was found of
            it there.
        image
            As in `separate`.

        Returns
        -------
        Cleaned

        Raises
        ------
        InputError
            Maps of different shapes; and as `separate`.
        """
        seen = self._seen(maps, mask, weights, image)
        maps = seen.within("maps", maps)
        if separate_on is not None and np.shape(separate_on) != maps.shape:
            got = np.shape(separate_on)
            raise InputError(f"separate_on must have the shape of maps, {maps.shape}, got {got}.")
        basis = maps if separate_on is None else seen.within("separate_on", separate_on)
        separation, modes = self._found(basis, freqs, beams, noise, rng, modes, seen)
        residual = separation.left_of(maps, basis, modes)
        seen.finish(maps, residual, separation)
        return Cleaned(maps=maps, residual=residual, separation=separation)

    def separate(
        self,
        maps,
        *,
        freqs,
        beams=None,
        noise=None,
        rng=None,
        modes=None,
        mask=None,
        weights=None,
        image=None,
    ):
        """Find the foreground.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; left as they are.
        freqs
            Channel centres, MHz, ascending, (n_channels,).
        beams
            b_l, (n_channels, lmax + 1), for methods that use them: positive and finite.
        noise
            Noise of the instrument per pixel, mK, a number or (n_channels,), for methods that use it.
        rng
            numpy Generator, for methods that draw numbers.
        modes
            The `CubeModes` of the maps less their channel means (`himap.removal.analysis.analysed`), where
            they are at hand, for methods that need them: to make them is half of the work. With a mask those
            of what is kept, less the means over it.
        mask
            (n_pix,) bool, True where kept; what is elsewhere may be anything and counts nothing, neither for
            the channel means. None keeps all.
        weights
            Hits or inverse variances, of which only ratios matter, for methods that take them: of pixels,
            (n_pix,), or of voxels, (n_channels, n_pix). A pixel without any is not kept. A voxel without any
            in a pixel with some is missing: what is there may be anything and counts nothing.
        image
            For pixels of an image in the plane: which of them the maps have, row by row, (n_y, n_x) bool.
            Methods that take any lines of sight do without.

        Returns
        -------
        Separation

        Raises
        ------
        InputError
            Maps that are not finite or of one channel; frequencies or beams that do not fit them; more
            sources than channels; a bad mask, or one that the method cannot work with; bad weights, or any
            if the method does not take them; an image of other pixels, or where the method needs the sphere.
        """
        seen = self._seen(maps, mask, weights, image)
        return self._found(seen.within("maps", maps), freqs, beams, noise, rng, modes, seen)[0]

    def _seen(self, maps, mask, weights, image):
        if weights is not None:
            self.check_weights(None)
        if image is not None and self.needs_sphere():
            raise InputError(f"{self.name} looks at the sphere, by multipoles; image= must be left out.")
        return Seen.of(maps, mask, weights, image)

    def _found(self, maps, freqs, beams, noise, rng, modes, seen):
        """The `Separation` of checked maps, and their `CubeModes` where the method needs them."""
        freqs = checked_freqs(freqs, len(maps))
        beams = self._own_beams(beams, len(maps))
        noise = self.checked_noise(noise, len(maps))
        self.check(len(maps))
        shape, kept, weights = maps.shape, seen.kept, seen.lines()
        in_plane = self.takes_image and seen.image is not None
        whole = kept is not None and self.needs_whole_sky and not in_plane
        if kept is not None:
            if not in_plane:
                self.check_kept(kept, beams)
            maps = maps[:, kept]
        if weights is not None:
            self.check_weights(weights)
        find = partial(self._separate, freqs=freqs, beams=beams, rng=rng)
        if self.needs_noise:
            find = partial(find, noise=noise)
        if self.needs_modes and not whole:
            modes = modes_of(maps) if modes is None else modes
        means = means_of(maps, weights) if self.centred else np.zeros(len(maps))
        maps = centred(maps, means) if self.centred else lean(maps)
        if whole:
            maps, modes = seen.completed(maps, modes)
        if self.needs_modes:
            find = partial(find, modes=modes)
        if in_plane:
            find = partial(find, image=seen.image_of_lines())
        if kept is not None and self.takes_mask:
            find = partial(find, kept=kept)
        if weights is not None:
            find = partial(find, weights=weights)
        separation = find(maps)
        separation = replace(
            separation, means=means if separation.means is None else means + separation.means
        )
        if kept is not None and not whole:
            separation = seen.among_all(separation)
        self._check_result(separation, shape)
        return separation, modes

    def _own_beams(self, beams, n_channels):
        if not self.needs_beams:
            return None
        if beams is None:
            raise InputError(
                f"{self.name} needs beams=, the b_l of every channel, (n_channels, lmax + 1); "
                "himap.instrument.beams makes those of the paper."
            )
        return checked_beams("beams", beams, n_channels)

    def checked_noise(self, noise, n_channels):
        """The noise per pixel of the instrument as a float, a tuple (n_channels,) or None, mK.

        Raises
        ------
        InputError
            It is not above zero, or of another number of channels, or missing where the method needs it.
        """
        noise = checked_noise("noise", noise)
        if isinstance(noise, tuple) and len(noise) != n_channels:
            raise InputError(
                f"noise must be one value or {n_channels}, one for each channel, got {len(noise)}."
            )
        return noise

    def _check_result(self, separation, shape):
        """Hold a method to what it promises, and pass on what it says of its result."""
        separation.check(type(self).__name__, shape)
        if not (separation.converged or self.ends_by_count):
            warnings.warn(
                f"{self.name}: stopped after {separation.n_iterations} iterations without converging.",
                SeparationWarning,
                stacklevel=4,
            )

    def check(self, n_channels):
        """Refuse, before any work, parameters that do not fit maps of `n_channels` channels.

        Raises
        ------
        InputError
            More sources than channels.
        """
        n_sources = getattr(self, "n_sources", 0)
        if n_sources > n_channels:
            raise InputError(
                f"n_sources must be at most the number of channels, {n_channels}, got {n_sources}."
            )

    def check_kept(self, kept, beams):
        """Refuse, before any work, a mask (n_pix,) bool that the method cannot work with.

        Parameters
        ----------
        kept
            True where kept.
        beams
            b_l, (n_channels, lmax + 1), or None for a method that does not use them.

        Raises
        ------
        InputError
            The pixels are no HEALPix sphere, where the method needs the whole sky.
        """
        if self.needs_whole_sky:
            from himap.maps import sphere

            sphere.nside_of(kept)

    def least_channels(self, n_channels):
        """How many of its channels a line of sight may not miss, for methods that take weights."""
        return 1

    def check_weights(self, weights):
        """Refuse, before any work, weights of lines of sight that the method cannot work with.

        Parameters
        ----------
        weights
            (n_pix,) or (n_channels, n_pix), of what is kept; None for whether there may be any.

        Raises
        ------
        InputError
            The method takes no weights, or too few channels are seen on some line of sight.
        """
        if not self.takes_weights:
            raise InputError(f"{self.name} takes no weights and no flags; parametric, pca and polynomial do.")
        if np.ndim(weights) == 2:
            check_lines(weights, self.least_channels(len(weights)), self.name)

    @abstractmethod
    def _separate(self, maps, *, freqs, beams, rng):
        """The `Separation` of `maps`, centred if the class says so; must not change them.

        They are float32, or float64 where that would round HI away (`himap.maps.blocked.precision`).
        """
