"""The survey: band, channels, sky resolution, dish, noise parameters and seed.

A `Survey` holds all that a simulation depends on besides the choice of Galaxy and beam. It is frozen
and small, so it is also the key of every cached product. The four presets are those of the
companion; every field of a preset can be overridden.
"""

import zlib
from dataclasses import dataclass, fields, replace

import numpy as np

from himap.core.checks import checked_fields, parameter, power_of_two
from himap.core.errors import InputError

FREQ_21CM = 1420.405751768
"""Rest frequency of the 21 cm line, MHz."""

NESTED_CELLS = 1024
"""Cells per side of the largest HI box with independent modes: larger boxes have its modes, and more."""


@dataclass(frozen=True, kw_only=True)
class Survey:
    """A single-dish intensity-mapping survey of the full sky (paper, Sect. 2).

    Attributes are documented in their ``help``; `Survey.describe` lists them. Frequencies are in
    MHz, lengths in Mpc/h unless said otherwise.

    Raises
    ------
    InputError
        If a field has the wrong type or is outside its range, or `nside` is not a power of two.
    """

    nside: int = parameter(64, "HEALPix resolution of the maps, a power of two", minimum=4, maximum=4096)
    n_channels: int = parameter(125, "number of frequency channels", minimum=2, maximum=100_000)
    freq_min: float = parameter(900.0, "lower edge of the band, MHz", minimum=240)
    freq_max: float = parameter(1400.0, "upper edge of the band, MHz", maximum=1420.0)
    box_cells: int = parameter(256, "cells along one side of the HI box, even", minimum=8, maximum=4096)
    box_size: float = parameter(3000.0, "side of the HI box, Mpc/h", minimum=100, maximum=20_000)
    r_smooth: float = parameter(
        0.0,
        "Gaussian smoothing of the density in the HI box, Mpc/h; 0 for none",
        minimum=0,
        maximum=100,
        off=0.0,
    )
    dish_diameter: float = parameter(13.5, "dish diameter, m", minimum=0, above=True)
    n_dishes: int = parameter(197, "number of dishes", minimum=1)
    t_obs: float = parameter(20_000.0, "total observing time, h", minimum=0, above=True)
    t_instr: float = parameter(25.0, "instrumental temperature, K", minimum=0)
    f_sky: float = parameter(1.0, "observed fraction of the sky", minimum=0, maximum=1, above=True)
    noise_reading: str = parameter(
        "deviation",
        "sigma_N of the noise formula is the standard deviation or variance of pixels; as a variance, its "
        "value in mK is read in mK^2 and the noise is its root, which depends on the unit",
        choices=("deviation", "variance"),
    )
    hi_bias: str = parameter(
        "exponential",
        "what the HI bias multiplies: the field in the exponential, or the lognormal density contrast",
        choices=("exponential", "contrast"),
        off="exponential",
    )
    taper: str = parameter(
        "none",
        "taper of lines of sight before their Fourier transform",
        choices=("none", "hann"),
        off="none",
    )
    seed: int = parameter(2025, "seed of every random stream", minimum=0, maximum=2**63)

    def __post_init__(self):
        checked_fields(self)
        power_of_two("nside", self.nside, 4, 4096)
        if self.box_cells % 2:
            raise InputError(
                "box_cells must be even, because the observer sits where eight cells meet; got "
                f"{self.box_cells}, try {self.box_cells + 1}."
            )
        if self.freq_min >= self.freq_max:
            raise InputError(
                f"the band must have freq_min < freq_max, got {self.freq_min} and {self.freq_max} MHz."
            )

    @classmethod
    def preset(cls, name="quick", **overrides):
        """The preset `name`, with any field overridden.

        InputError for an unknown preset or field (the message lists the valid ones), or an invalid value.
        """
        if not isinstance(name, str) or name not in PRESETS:
            raise InputError(f"unknown preset {name!r}; there are {', '.join(PRESETS)}.")
        unknown = sorted(set(overrides) - {item.name for item in fields(cls)})
        if unknown:
            raise InputError(f"unknown Survey field {', '.join(unknown)}; the fields are:\n{cls.describe()}")
        return replace(PRESETS[name], **overrides)

    @classmethod
    def describe(cls):
        """Every field with its type and help, one per line."""
        return "\n".join(
            f"  {item.name}: {item.type.__name__}  {item.metadata['help']}" for item in fields(cls)
        )

    @property
    def freqs(self):
        """Channel centres, MHz, ascending, shape (n_channels,)."""
        return self.freq_edges[:-1] + 0.5 * self.channel_width

    @property
    def freq_edges(self):
        """Channel edges, MHz, ascending, shape (n_channels + 1,)."""
        return np.linspace(self.freq_min, self.freq_max, self.n_channels + 1)

    @property
    def channel_width(self):
        """Width of a channel, MHz."""
        return (self.freq_max - self.freq_min) / self.n_channels

    @property
    def n_pix(self):
        """Number of pixels of a map."""
        return 12 * self.nside**2

    @property
    def lmax(self):
        """Largest multipole of the transforms, 3 nside - 1."""
        return 3 * self.nside - 1

    @property
    def sky(self):
        """This survey with the default instrument: the part that a simulated sky depends on."""
        instrument = ("dish_diameter", "n_dishes", "t_obs", "t_instr", "f_sky", "noise_reading", "taper")
        return replace(self, **{name: getattr(Survey, name) for name in instrument})

    def check_untapered(self):
        """Raise InputError if there is a `taper`, for spectra of mocks, cubes and images, which have none."""
        if self.taper != "none":
            raise InputError(
                f"spectra of mocks, cubes and images have no taper, got taper={self.taper!r}; leave it out, "
                "or measure the claims, which have it."
            )

    def rng(self, component):
        """The random stream of one named component.

        Streams of different names are independent, so changing one component does not change the others.
        """
        key = zlib.crc32(component.encode())
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(key,)))


PRESETS = {
    "ci": Survey(nside=32, n_channels=100, box_cells=128),
    "quick": Survey(nside=64, n_channels=125, box_cells=256),
    "laptop": Survey(nside=128, n_channels=250, box_cells=512),
    "paper": Survey(nside=256, n_channels=500, box_cells=1024),
}
"""For tests; the default, seconds; a closer look, minutes; the paper."""
