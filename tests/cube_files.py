"""A cube of one's own, in a file, and the commands on it."""

import h5py
import numpy as np
from click.testing import CliRunner

from himap.app.cli.main import main

NSIDE = 16
N_PIX = 12 * NSIDE**2
FREQS = np.linspace(950, 1050, 24)
STOKES = ("I", "Q", "U", "V")


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


def write_container(path, maps, freqs, *, pols=STOKES, axis=("freq", "pol", "pixel"), words="S5", **datasets):
    """A container of cora with maps (n_channels, n_pix), mK, as kelvin; Q, U and V have other numbers.

    `datasets`, with __ for /, are in place of its own, None for none.
    """
    cube = np.full((len(maps), len(pols), maps.shape[1]), 1e6)
    cube[:, [pol == "I" for pol in pols]] = maps[:, None] / 1e3
    table = np.zeros(len(maps), dtype=[("centre", np.float64), ("width", np.float64)])
    table["centre"], table["width"] = freqs, 5.0
    items = {"index_map/freq": table, "index_map/pol": np.array(pols).astype(words)}
    items |= {"index_map/pixel": np.arange(maps.shape[1])}
    items |= {name.replace("__", "/"): values for name, values in datasets.items()}
    with h5py.File(path, "w") as file:
        file.attrs["__memh5_distributed_file"] = True
        dataset = file.create_dataset("map", data=cube)
        dataset.attrs.update({"axis": np.array(axis).astype(words), "__memh5_distributed_dset": True})
        for name in (name for name, values in items.items() if values is not None):
            file[name] = items[name]


def run(*words, code=0):
    """The outcome of a command that ends with this exit code."""
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert done.exit_code == code, (words, done.output)
    return done
