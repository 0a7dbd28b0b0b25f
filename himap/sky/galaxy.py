"""The Galaxy from one of three sources (paper, Sects. 2.1.2-2.1.3), its dimming, and all foregrounds."""

import os
from dataclasses import dataclass

import numpy as np

from himap.core.checks import checked_fields, parameter, power_of_two
from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.healpix_io import read_maps
from himap.sky.point_sources import point_sources
from himap.sky.small_scales import refine_template
from himap.sky.synthetic import synthetic_galaxy
from himap.sky.templates import (
    EXPECTED_FILES,
    digest_of,
    find_templates,
    pysm_templates,
    pysm_version,
    read_templates,
)

SOURCES = ("synthetic", "templates", "pysm3")
"""Synthetic; FITS files in a folder; models s1 and f1 of PySM 3, as in the paper."""

_WIDTHS = 3  # standard deviations of the dimming between the plane and its edge


@dataclass(frozen=True, kw_only=True)
class Galaxy:
    """Choice of the simulated Galaxy.

    Parameters
    ----------
    source
        "synthetic", "templates" or "pysm3".
    template_dir
        For "templates": the folder of the three FITS files (see `himap.sky.templates.read_templates`).
    small_scales
        Whether to add structure beyond the resolution of templates ("synthetic" has it at any nside).

    Raises
    ------
    InputError
        For an unknown source, a folder that is missing, does not exist or is not needed, or "synthetic"
        without small scales.
    """

    source: str = "synthetic"
    template_dir: str | None = None
    small_scales: bool = True

    def __post_init__(self):
        if self.source not in SOURCES:
            raise InputError(f"unknown Galaxy {self.source!r}; there are {', '.join(SOURCES)}.")
        if not isinstance(self.small_scales, (bool, np.bool_)):
            raise InputError(f"small_scales must be True or False, got {self.small_scales!r}.")
        if self.source == "synthetic" and not self.small_scales:
            raise InputError(
                "small_scales=False is for templates; the synthetic Galaxy has small scales at any nside: "
                "leave it out, or choose the Galaxy 'templates'."
            )
        if self.source == "templates":
            if not isinstance(self.template_dir, (str, os.PathLike)):
                raise InputError(
                    f"the Galaxy 'templates' needs template_dir, a folder with {EXPECTED_FILES}; got "
                    f"{self.template_dir!r}."
                )
            object.__setattr__(self, "template_dir", os.path.expanduser(self.template_dir))
            find_templates(self.template_dir)
        elif self.template_dir is not None:
            raise InputError(
                f"template_dir is for the Galaxy 'templates' alone, got {str(self.template_dir)!r} "
                f"with {self.source!r}; leave it out or choose the Galaxy 'templates'."
            )

    @property
    def label(self):
        """Text below figures: the source, and for templates their nside, beyond which the sky is not real.

        Raises
        ------
        InputError
            If a template cannot be read.
        """
        if self.source != "templates":
            return self.source
        files = find_templates(self.template_dir).values()
        nsides = sorted({sphere.nside_of(read_maps(path, n_maps=1).maps) for path in files})
        return f"templates (nside {', '.join(map(str, nsides))})"

    def components(self, nside, rng):
        """Synchrotron and free-free, a list of two `PowerLaw`: amplitudes in mK, RING, Galactic.

        T(nu, p) = amplitude(p) (nu / freq_ref)^index(p) (paper, Eqs. 1 and 2). Each component has a
        separate random stream, a child of `rng`.

        Raises
        ------
        InputError
            If `nside` is not a power of two, a template is unusable, or PySM cannot download its templates.
        """
        nside = power_of_two("nside", nside, 1, 8192)
        if self.source == "synthetic":
            return synthetic_galaxy(nside, rng)
        templates = read_templates(self.template_dir) if self.source == "templates" else pysm_templates(nside)
        return [
            refine_template(template, nside, stream, small_scales=self.small_scales)
            for template, stream in zip(templates, rng.spawn(len(templates)), strict=True)
        ]

    def digest(self):
        """A hash of what determines the components besides the fields: files, or the pysm3 version."""
        if self.source == "templates":
            return digest_of(self.template_dir)
        if self.source == "pysm3":
            return pysm_version()
        return ""


@dataclass(frozen=True, kw_only=True)
class Dimming:
    """A weight by Galactic latitude that mimics a mask before cleaning.

    w(b) = 1 - (1 - w_0) (g(b) - g(edge)) / (1 - g(edge)) with the Gaussian g(b) = exp(-b^2 / (2 sigma^2)),
    sigma = edge / 3, and w = 1 beyond the edge. The paper gives the weight in the plane, 0.1, and the
    latitude beyond which the sky is unchanged, 15 deg, but not the width of its Gaussian.

    Raises
    ------
    InputError
        If the weight is outside 0 to 1, or the edge outside 0 to 90 deg.
    """

    weight: float = parameter(0.1, "weight of the foregrounds at b = 0", minimum=0, maximum=1)
    edge: float = parameter(
        15.0, "latitude beyond which nothing changes, deg", minimum=0, maximum=90, above=True
    )

    def __post_init__(self):
        checked_fields(self)

    def weights(self, nside):
        """The weight of every pixel, (n_pix,) float64, RING, Galactic."""
        x = np.minimum(np.abs(sphere.pixel_latitude(nside)) / self.edge, 1)
        end = np.exp(-0.5 * _WIDTHS**2)
        return 1 - (1 - self.weight) * (np.exp(-0.5 * (_WIDTHS * x) ** 2) - end) / (1 - end)


def foreground_components(survey, galaxy):
    """Every foreground as a `PowerLaw`: synchrotron, free-free, point sources.

    The Galaxy and the point sources have separate random streams, so changing one leaves the other unchanged.

    Parameters
    ----------
    survey
        A `Survey`.
    galaxy
        A `Galaxy`.
    """
    return [
        *galaxy.components(survey.nside, survey.rng("galaxy")),
        point_sources(survey.nside, survey.rng("point sources")),
    ]
