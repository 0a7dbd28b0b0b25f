"""A cube of one's own, in a file, and the commands on it."""

import h5py
import numpy as np
from click.testing import CliRunner

from himap.app.cli.main import main

NSIDE = 16
N_PIX = 12 * NSIDE**2
FREQS = np.linspace(950, 1050, 24)


def power_law_maps(rng):
    """Two power laws and noise, mK, RING, by frequency; (24, 3072) float32."""
    amplitudes = 1e3 * np.exp(rng.standard_normal((2, N_PIX)))
    spectra = (FREQS / 1000)[:, None] ** np.array([-2.1, -2.8])
    return (spectra @ amplitudes + rng.standard_normal((len(FREQS), N_PIX))).astype(np.float32)


def write_hdf5(path, maps, freqs=FREQS, **attributes):
    with h5py.File(path, "w") as file:
        file.create_dataset("sky/cube", data=maps)
        file.create_dataset("sky/freq", data=freqs)
        file.attrs.update(attributes)
    return path


def himap(*words):
    return CliRunner().invoke(main, [str(word) for word in words])
