"""The same last digits on every machine of a kind: the arithmetic of numpy's and scipy's linear algebra.

OpenBLAS, which comes with their wheels, has a set of routines for each generation of processors and takes
the newest that a processor knows. The sets add up in another order, so that results differ in the last digit.
Most methods do not care. SDecGMCA does: one digit more or less decides which coefficients pass a threshold,
and hundreds of iterations later the answer is another one. So the command and the kernels of notebooks all
take the set that every x86-64 processor since 2013 knows. Nothing else that is installed with himap was found
to change a digit from one such processor to another.
"""

import os
import platform
from pathlib import Path

__all__ = ["VARIABLE", "same_everywhere"]

VARIABLE = "OPENBLAS_CORETYPE"
"""What OpenBLAS reads when it is loaded: the name of a set of routines."""

_SET = "Haswell"
_NEEDED = {"avx2", "fma"}  # what its routines are made of: OpenBLAS does not look whether they are there


def same_everywhere(processor=Path("/proc/cpuinfo")):
    """The environment variables that fix the arithmetic, {name: text}, for a process that has no numpy yet.

    Empty where somebody chose a set, and where it is not known that the processor has ours: processors other
    than x86-64, systems other than Linux.
    """
    if VARIABLE in os.environ or platform.machine().lower() not in ("x86_64", "amd64"):
        return {}
    try:
        known = set(processor.read_text(encoding="utf-8", errors="replace").split())
    except OSError:
        return {}
    return {VARIABLE: _SET} if known.issuperset(_NEEDED) else {}
