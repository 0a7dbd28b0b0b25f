"""The Galaxy: synchrotron and free-free emission from one of three sources (paper, Sects. 2.1.2-2.1.3)."""

import os
from dataclasses import dataclass

import numpy as np

from himap.core.errors import InputError
from himap.sky.pysm import pysm_templates, pysm_version
from himap.sky.synthetic import synthetic_galaxy
from himap.sky.templates import EXPECTED_FILES, digest_of, find_templates, nsides_of, read_templates

SOURCES = ("synthetic", "templates", "pysm3")
"""Made on the spot; FITS files of a folder; PySM 3's models s1 and f1, the paper's own."""


@dataclass(frozen=True, kw_only=True)
class Galaxy:
    """Which Galaxy to simulate.

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
        An unknown source, or a folder that is missing, does not exist or has no use.
    """

    source: str = "synthetic"
    template_dir: str | None = None
    small_scales: bool = True

    def __post_init__(self):
        if self.source not in SOURCES:
            raise InputError(f"unknown Galaxy source {self.source!r}; there are {', '.join(SOURCES)}.")
        if not isinstance(self.small_scales, (bool, np.bool_)):
            raise InputError(f"small_scales must be True or False, got {self.small_scales!r}.")
        if self.source == "templates":
            if self.template_dir is None:
                raise InputError(
                    f"the Galaxy source 'templates' needs template_dir, a folder with {EXPECTED_FILES}."
                )
            if not isinstance(self.template_dir, (str, os.PathLike)):
                raise InputError(f"template_dir must be the path of a folder, got {self.template_dir!r}.")
            object.__setattr__(self, "template_dir", os.path.expanduser(self.template_dir))
            find_templates(self.template_dir)
        elif self.template_dir is not None:
            raise InputError(
                f"template_dir is for the Galaxy source 'templates' alone, got {str(self.template_dir)!r} "
                f"with {self.source!r}; leave it out or say source='templates'."
            )

    @property
    def label(self):
        """What figures say under them: the source, and of templates their nside, where the real sky ends.

        Raises
        ------
        InputError
            A template that cannot be read.
        """
        if self.source != "templates":
            return self.source
        nsides = sorted(set(nsides_of(self.template_dir).values()))
        return f"templates (nside {', '.join(map(str, nsides))})"

    def components(self, nside, rng):
        """Synchrotron and free-free, a list of two `PowerLaw`: amplitudes in mK, RING, Galactic.

        T(nu, p) = amplitude(p) (nu / freq_ref)^index(p) (paper, Eqs. 1 and 2). Each component has a random
        stream of its own, a child of `rng`.

        Raises
        ------
        InputError
            `nside` is no power of two, a template is not usable, or PySM cannot download its own.
        """
        if nside != int(nside) or nside < 1 or int(nside) & (int(nside) - 1):
            raise InputError(f"nside must be a power of two, got {nside!r}.")
        nside = int(nside)
        if self.source == "synthetic":
            return synthetic_galaxy(nside, rng)
        templates = read_templates(self.template_dir) if self.source == "templates" else pysm_templates(nside)
        return [
            template.power_law(nside, stream, small_scales=self.small_scales)
            for template, stream in zip(templates, rng.spawn(len(templates)), strict=True)
        ]

    def digest(self):
        """A hash of what the components depend on besides the fields: files, or the version of pysm3."""
        if self.source == "templates":
            return digest_of(self.template_dir)
        if self.source == "pysm3":
            return pysm_version()
        return ""
