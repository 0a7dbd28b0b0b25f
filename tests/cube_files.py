"""A cube of one's own, in a file, and the commands on it."""

import h5py
import numpy as np
from click.testing import CliRunner

from himap.app.cli.main import main

NSIDE = 16
N_PIX = 12 * NSIDE**2
FREQS = np.linspace(950, 1050, 24)


def power_laws(rng, freqs, *shape):
    """Two power laws and noise, mK, (n_channels, *shape) float32."""
    amplitudes = 1e3 * np.exp(rng.standard_normal((2, *shape)))
    maps = np.tensordot((freqs / 1000)[:, None] ** np.array([-2.1, -2.8]), amplitudes, axes=1)
    return (maps + rng.standard_normal(maps.shape)).astype(np.float32)


def power_law_maps(rng):
    """`power_laws` of the whole sky, RING, (24, 3072)."""
    return power_laws(rng, FREQS, N_PIX)


def write_hdf5(path, maps, freqs=FREQS, **attributes):
    """A cube in HDF5, in mK and RING unless it has other attributes."""
    with h5py.File(path, "w") as file:
        file.create_dataset("sky/cube", data=maps)
        file.create_dataset("sky/freq", data=freqs)
        file.attrs.update(attributes or {"unit": "mK", "order": "RING"})
    return path


def run(*words, code=0):
    """The outcome of a command that ends with this exit code."""
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert done.exit_code == code, (words, done.output)
    return done
