"""Kernels that are spoken to through files, not ports.

Two kernels that start at the same time may choose the same free port, and one of them dies. That happens
when several notebooks run at once, by hand or in tests.
"""

import os
import tempfile
from functools import cache
from pathlib import Path
from uuid import uuid4

from jupyter_client import AsyncKernelManager, KernelManager

__all__ = ["AsyncLocalKernelManager", "LocalKernelManager"]


@cache
def _sockets():
    """A folder for the files, until this process ends."""
    return tempfile.TemporaryDirectory(prefix="himap")


class _ThroughFiles:
    def __init__(self, **options):
        super().__init__(**options)
        if os.name == "posix":
            self.transport = "ipc"
            self.ip = str(Path(_sockets().name, uuid4().hex))


class LocalKernelManager(_ThroughFiles, KernelManager):
    """For nbval."""


class AsyncLocalKernelManager(_ThroughFiles, AsyncKernelManager):
    """For papermill."""
