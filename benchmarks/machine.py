"""What this machine can do, measured on the spot, and what a step needs of it at least: its floor."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from himap.maps import sphere

_BYTES = 2**28  # of an array far larger than the caches
_SIDE = 1500  # of the matrices that are multiplied


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Bytes moved and operations done in a second, and seconds of one transform, in float32 and float64."""

    bandwidth: float
    operations: float
    operations_single: float
    transform: float
    transform_single: float

    @classmethod
    def measured(cls, nside):
        """Of this machine, all cores, with transforms between maps of `nside` and l = 3 nside - 1."""
        source, target = np.ones(_BYTES // 8), np.zeros(_BYTES // 8)
        matrix = np.random.default_rng(0).standard_normal((_SIDE, _SIDE))
        single = matrix.astype(np.float32)
        alm = sphere.gaussian_alm(np.ones(3 * nside), np.random.default_rng(0))
        alm_single = alm.astype(np.complex64)
        return cls(
            bandwidth=2 * _BYTES / _quickest(lambda: np.copyto(target, source)),
            operations=2 * _SIDE**3 / _quickest(lambda: matrix @ matrix),
            operations_single=2 * _SIDE**3 / _quickest(lambda: single @ single),
            transform=_quickest(lambda: sphere.synthesise(alm, nside)),
            transform_single=_quickest(lambda: sphere.synthesise(alm_single, nside)),
        )


@dataclass(frozen=True, kw_only=True)
class Needs:
    """What a step cannot do without: transforms, bytes moved, operations of matrix products."""

    transforms: float = 0
    transforms_single: float = 0
    n_bytes: float = 0
    operations: float = 0
    operations_single: float = 0

    def floor(self, machine):
        """Seconds on `machine`, if nothing were lost and nothing overlapped."""
        return (
            self.transforms * machine.transform
            + self.transforms_single * machine.transform_single
            + self.n_bytes / machine.bandwidth
            + self.operations / machine.operations
            + self.operations_single / machine.operations_single
        )


def _quickest(function):
    """Seconds of the quickest of five calls, after one that does not count."""
    function()
    seconds = []
    for _ in range(5):
        started = perf_counter()
        function()
        seconds.append(perf_counter() - started)
    return min(seconds)
