"""The same last digits on every machine of a kind: the arithmetic of numpy's and scipy's linear algebra.

OpenBLAS, which comes with their wheels, has a set of routines for each generation of processors and takes
the newest that a processor knows. The sets add up in another order, so that results differ in the last digit.
Most methods do not care. SDecGMCA does: one digit more or less decides which coefficients pass a threshold,
and many iterations later the answer is another one. So the command and the kernels of notebooks all
take the set that x86-64 processors with AVX2 know, nearly all since 2013. Nothing else that is installed with
himap was found to change a digit from one such processor to another.
"""

import os
import platform
from pathlib import Path

__all__ = ["CHOICE", "VARIABLE", "same_everywhere"]

VARIABLE = "OPENBLAS_CORETYPE"
"""What OpenBLAS reads when it is loaded: the name of a set of routines. It is there on some machines, with
another set for each.
"""

CHOICE = "HIMAP_CORETYPE"
"""Where somebody names another set for himap, to see what hangs on it."""

_SET = "Haswell"
_NEEDED = {"avx2", "fma"}  # what its routines are made of: OpenBLAS does not look whether they are there


def same_everywhere(processor=Path("/proc/cpuinfo")):
    """The environment variables that fix the arithmetic, {name: text}, for a process that has no numpy yet.

    Empty where it is not known that the processor has our set: processors other than x86-64, systems other
    than Linux.
    """
    if chosen := os.environ.get(CHOICE):
        return {VARIABLE: chosen}
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return {}
    try:
        known = set(processor.read_text(encoding="utf-8", errors="replace").split())
    except OSError:
        return {}
    return {VARIABLE: _SET} if known.issuperset(_NEEDED) else {}
