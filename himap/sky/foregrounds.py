"""The Galaxy and the point sources, added up."""

from himap.sky.emission import emission_maps
from himap.sky.point_sources import point_sources


def foreground_components(survey, galaxy):
    """Every foreground as a `PowerLaw`: synchrotron, free-free, point sources.

    The Galaxy and the sources have a random stream each, so a change of one leaves the other.

    Parameters
    ----------
    survey
        A `Survey`.
    galaxy
        A `himap.sky.galaxy.Galaxy`.
    """
    return [
        *galaxy.components(survey.nside, survey.rng("galaxy")),
        point_sources(survey.nside, survey.rng("point sources")),
    ]


def foreground_maps(survey, galaxy):
    """All foregrounds of every channel, mK, (n_channels, n_pix) float32."""
    return emission_maps(foreground_components(survey, galaxy), survey.freqs)
