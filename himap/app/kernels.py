"""Kernels that are spoken to through files, not ports, all of which lie in one folder of this process.

Two kernels that start at the same time may choose the same free port, and one of them dies. That happens
when several notebooks run at once, by hand or in tests.
"""

import os
from uuid import uuid4

from jupyter_client import AsyncKernelManager, KernelManager

from himap.core.files import run_folder

_LONGEST = 100  # bytes of the name of a socket; some systems end at 103


class _ThroughFiles:
    def __init__(self, **options):
        super().__init__(**options)
        name = str(run_folder() / uuid4().hex[:8])
        self.connection_file = f"{name}.json"
        if os.name == "posix" and len(os.fsencode(name)) < _LONGEST:
            self.transport, self.ip = "ipc", name


class LocalKernelManager(_ThroughFiles, KernelManager):
    """For nbval."""


class AsyncLocalKernelManager(_ThroughFiles, AsyncKernelManager):
    """For papermill."""
