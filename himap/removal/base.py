"""What all methods of foreground removal share: checks, subtraction and the registry.

A method is a frozen dataclass of its parameters with one hook, `_separate`. To add one, write one file with
one class in `himap/removal/`; it is registered under its name, and the contract test covers it automatically.
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

_SPATIAL = {"sphere", "neighbours"}  # uses that need more than the pixels of a part of the sphere


class SeparationWarning(UserWarning):
    """A method ended without converging, or or with a result that needs a remark."""


@dataclass(frozen=True, kw_only=True)
class ForegroundRemover(ABC):
    """A method of foreground removal; its fields are its parameters.

    Attributes
    ----------
    name
        Name of the method in `removal.create`, in file names and in figures.
    uses
        What the method needs or accepts beyond maps and frequencies:

        - "beams": the beams of the instrument, which must be given;
        - "noise": the noise of the instrument; it may be None, so a method that needs it must check;
        - "sphere": multipoles, so the pixels are a full HEALPix sphere, or a part continued to it;
        - "neighbours": pixels around each pixel, of a HEALPix sphere as above or an image in the plane;
        - "weights": weights of pixels and voxels; other methods refuse weights that are not all equal.
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
        """Estimate the foreground and subtract it.

        Parameters
        ----------
        maps
            (n_channels, n_pix), mK; not changed.
        separate_on
            Maps of the same shape in which to estimate the foreground, such as `maps` with their peaks
            masked; default: `maps`. The foreground is always subtracted from `maps`.
        given
            `freqs`, and, where needed, `beams`, `noise`, `rng`, `mask`, `weights` and `image` (`Data.of`).

        Returns
        -------
        Cleaned
            The cleaned maps of all given pixels, 0 in pixels that are not kept. In missing voxels the
            residual is 0, and the maps hold the estimated foreground.

        Raises
        ------
        InputError
            If shapes differ, if an input is invalid by itself (`Data.of`), or if it does not suit this
            method: more sources than channels, missing beams or noise, weights that it does not support,
            or pixels that are not a sphere where it needs one.
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
        """The `Separation` of `Data`; raises the errors of `clean`; `stacklevel` as in `warnings.warn`."""
        self.check(len(data.maps))
        self.check_data(data)
        whole = data.on_sphere() if self.uses & _SPATIAL and data.image is None else data
        try:
            # A different order of summation changes the result after many iterations. On one thread, machines
            # with the same libraries agree, whatever their number of cores. Transforms may use all threads.
            with threadpool_limits(1, user_api="blas"):
                found = self._separate(whole)
        except np.linalg.LinAlgError as error:
            raise InputError(
                f"{self.name} cannot solve its equations for these maps ({error}): the brightest part is too "
                "bright relative to the faintest. Use another method, or maps in float64."
            ) from None
        found = found if found.means is not None else replace(found, means=whole.means)
        found.check(type(self).__name__, whole.maps.shape)
        if not (found.converged or has_restarts(self)):  # those end after a fixed count, as published
            warnings.warn(
                f"{self.name}: stopped after {found.n_iterations} iterations without converging.",
                SeparationWarning,
                stacklevel=stacklevel,
            )
        return found if whole is data else found.moved(lambda lines: lines[..., data.grid])

    def check(self, n_channels):
        """Raise InputError, before any work, if parameters do not fit maps of `n_channels` channels."""
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
        """Smallest number of observed channels that a line of sight needs."""
        return 1

    def check_data(self, data):
        """Raise InputError, before any work, if `Data` lack what the method needs or hold what it refuses."""
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
        """Raise InputError for weights that the method does not support: any, or those with wide gaps."""
        if "weights" not in self.uses:
            raise InputError(f"{self.name} takes no weights and no flags; parametric, pca and polynomial do.")
        if np.ndim(weights) == 2:
            check_channels(weights, self.least_channels(len(weights)), self.name)

    @abstractmethod
    def _separate(self, data):
        """Return the `Separation` of `Data`, whose maps must not be changed.

        Use `data.centred`, maps less the means that the base class subtracts too, or `data.total`: then the
        result has `means` of 0. For a part of the sphere, a method that uses "sphere" or "neighbours" gets
        maps that continue smoothly outside of `data.inside`, where they hold no HI.
        """
