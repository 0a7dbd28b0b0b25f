"""What every method of foreground removal has in common: checks, subtraction, the register.

A method is a frozen dataclass of its parameters with one hook, `_separate`. To add one, write one file with
one class in `himap/removal/`; it registers by its name, and the contract test runs on it by itself.
"""

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from threadpoolctl import threadpool_limits

from himap.core.checks import checked_fields, checked_noise, parameter
from himap.core.errors import InputError
from himap.maps.low_rank import scattered
from himap.removal.cleaning import Cleaning
from himap.removal.data import Data, check_channels
from himap.removal.restarts import has_restarts, remarks_on_one
from himap.removal.separation import Cleaned, Separation

__all__ = ["REGISTRY", "Cleaned", "ForegroundRemover", "Separation", "SeparationWarning", "parameter"]

REGISTRY = {}

_SPATIAL = {"sphere", "neighbours"}  # uses for which the pixels of a part of the sphere are not enough


class SeparationWarning(UserWarning):
    """A method ended without converging, or with something the user should know."""


@dataclass(frozen=True, kw_only=True)
class ForegroundRemover(ABC):
    """A method of foreground removal; its fields are its parameters.

    Attributes
    ----------
    name
        What it is called in `removal.create`, in file names and in figures.
    uses
        What the method needs or accepts beyond maps and frequencies:

        - "beams": those of the instrument, which must be given;
        - "noise": that of the instrument, which may be None, so that a method that needs it checks for it;
        - "sphere": multipoles, so the pixels are a full HEALPix sphere, or a part that is continued to it;
        - "neighbours": pixels around each pixel, of a HEALPix sphere as before, or of an image in the plane;
        - "weights": of pixels and voxels, where they differ; other methods refuse them.
    """

    name: ClassVar[str]
    uses: ClassVar[frozenset] = frozenset()

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        REGISTRY[cls.name] = cls

    def __post_init__(self):
        checked_fields(self)
        if hasattr(self, "noise"):
            object.__setattr__(self, "noise", checked_noise("noise", self.noise))

    def clean(self, maps, *, separate_on=None, **given):
        """Find the foreground and subtract it.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; not changed.
        separate_on
            Maps of the same shape to find the foreground in, such as `maps` with their peaks masked; `maps`
            themselves unless given. The foreground is always subtracted from `maps`.
        given
            `freqs`, and as needed `beams`, `noise`, `rng`, `mask`, `weights` and `image` (`Data.of`).

        Returns
        -------
        Cleaned
            Of all pixels given, with 0 where none is kept; the residual is 0 where a voxel is missing, and
            the foreground there is what was found of it.

        Raises
        ------
        InputError
            Maps of different shapes; what is not valid by itself (`Data.of`), or not for this method: more
            sources than channels, missing beams or noise, weights that it does not take, pixels that are not
            a sphere where it needs one.
        """
        if given.get("weights") is not None:
            self.check_weights()
        data = basis = Data.of(maps, **given)
        if separate_on is not None:
            shape, other = np.shape(maps), np.shape(separate_on)
            if shape != other:
                raise InputError(f"separate_on must have the shape of maps, {shape}, got {other}.")
            basis = Data.of(separate_on, label="separate_on", **given)
        cleaning = Cleaning(data=data, method=self, basis=basis)
        vars(cleaning)["separation"] = separation = self.separate(basis, stacklevel=3)
        maps, residual = cleaning.maps, cleaning.residual
        if remarks := remarks_on_one(cleaning):
            warnings.warn(" ".join(remarks), SeparationWarning, stacklevel=2)
        kept = data.grid if data.image is None else data.image[given["image"]]
        if kept is not None:
            maps, residual = scattered(maps, kept), scattered(residual, kept)
            separation = separation.moved(lambda lines: scattered(lines, kept))
        return Cleaned(maps=maps, residual=residual, separation=separation)

    def separate(self, data, *, stacklevel=2):
        """The `Separation` of `Data`; errors as of `clean`, `stacklevel` as of `warnings.warn`."""
        self.check(len(data.maps))
        self.check_data(data)
        whole = data.on_sphere() if self.uses & _SPATIAL and data.image is None else data
        try:
            # Sums in another order end elsewhere after many turns: one thread, so that machines with the same
            # libraries agree whatever their number of cores. Transforms keep theirs, which do not matter.
            with threadpool_limits(1, user_api="blas"):
                found = self._separate(whole)
        except np.linalg.LinAlgError as error:
            raise InputError(
                f"{self.name} cannot solve its equations for these maps ({error}): the brightest part is too "
                "much brighter than the faintest. Take another method, or maps in float64."
            ) from None
        found = found if found.means is not None else replace(found, means=whole.means)
        found.check(type(self).__name__, whole.maps.shape)
        if not (found.converged or has_restarts(self)):  # those end by count, as published
            warnings.warn(
                f"{self.name}: stopped after {found.n_iterations} iterations without converging.",
                SeparationWarning,
                stacklevel=stacklevel,
            )
        return found if whole is data else found.moved(lambda lines: lines[..., data.grid])

    def check(self, n_channels):
        """InputError, before any work, for parameters that do not fit maps of `n_channels` channels."""
        n_sources = getattr(self, "n_sources", 0)
        if n_sources > n_channels:
            raise InputError(
                f"n_sources must be at most the number of channels, {n_channels}, got {n_sources}."
            )
        least = self.least_channels(n_channels)
        if n_channels < least:
            raise InputError(f"{self.name} needs {least} channels or more, got {n_channels}.")
        checked_noise("noise", getattr(self, "noise", None), n_channels)

    def least_channels(self, n_channels):
        """How many of its channels a line of sight may not miss."""
        return 1

    def check_data(self, data):
        """InputError, before any work, for `Data` that lack what it needs or have what it does not take."""
        if "beams" in self.uses and data.beams is None:
            raise InputError(
                f"{self.name} needs beams=, the b_l of every channel, (n_channels, lmax + 1); "
                "himap.instrument.beams makes those of the paper."
            )
        if data.image is None and self.uses & _SPATIAL:
            from himap.maps import sphere

            sphere.nside_of(data.maps if data.grid is None else data.grid)
        elif "sphere" in self.uses:
            raise InputError(f"{self.name} looks at the sphere, by multipoles; image= must be left out.")
        if data.weights is not None:
            self.check_weights(data.weights)

    def check_weights(self, weights=None):
        """InputError for weights that the method does not take: any at all, or those with wide gaps."""
        if "weights" not in self.uses:
            raise InputError(f"{self.name} takes no weights and no flags; parametric, pca and polynomial do.")
        if np.ndim(weights) == 2:
            check_channels(weights, self.least_channels(len(weights)), self.name)

    @abstractmethod
    def _separate(self, data):
        """The `Separation` of `Data`, whose maps must not be changed.

        Maps come as `data.centred`, less the means that the base class subtracts too, or as `data.total`:
        then the result has `means` of 0. Of a part of the sphere a method that uses the sphere or neighbours
        gets maps that go on smoothly outside of `data.inside`, where they hold no HI.
        """
