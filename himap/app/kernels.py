"""Kernels in the Python of this process, connected through files in one folder of it.

They use neither the first kernel called python3 on Jupyter's path nor ports: two kernels that start at the
same time may choose the same free port, and one of them fails, if several notebooks run at the same time,
manually or in tests.
"""

import os
from uuid import uuid4

from ipykernel.kernelspec import get_kernel_dict
from jupyter_client import AsyncKernelManager, KernelManager
from jupyter_client.kernelspec import KernelSpec

from himap.core.files import run_folder

_LONGEST = 100  # bytes of a socket name; some systems allow only 103


class _ThroughFiles:
    def __init__(self, **options):
        super().__init__(**options)
        name = str(run_folder() / uuid4().hex[:8])
        self.connection_file = f"{name}.json"
        if os.name == "posix" and len(os.fsencode(name)) < _LONGEST:
            self.transport, self.ip = "ipc", name

    @property
    def kernel_spec(self):
        """That of `sys.executable`, started here, independent of the kernel name and configuration."""
        spec = KernelSpec(**get_kernel_dict())
        spec.metadata["kernel_provisioner"] = {"provisioner_name": "local-provisioner"}
        return spec


class LocalKernelManager(_ThroughFiles, KernelManager):
    """For nbval."""


class AsyncLocalKernelManager(_ThroughFiles, AsyncKernelManager):
    """For papermill; a kernel that ends by itself stores its exit code in the class."""

    exit_code = None

    async def _async_is_alive(self):
        alive = await super()._async_is_alive()
        if not alive and self.has_kernel:
            type(self).exit_code = await self.provisioner.poll()
        return alive

    is_alive = _async_is_alive
