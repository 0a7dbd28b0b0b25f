"""himap: foreground removal in HI intensity mapping, a companion of Gkogkou et al. (2025)."""

import sys

__all__ = ["__version__"]

__version__ = "0.1.0"


class _WhenNumbaIsImported:
    """Finds no module, but sees numba come, which takes a second that not every process needs to spend."""

    name = "numba.core.dispatcher"

    def find_spec(self, name, path=None, target=None):
        if name != self.name:
            return None
        from importlib.util import find_spec

        from himap.core.compiled import keep_ours

        sys.meta_path.remove(self)
        spec = find_spec(name)
        execute = spec.loader.exec_module

        def executed(module):
            execute(module)
            keep_ours(module)

        spec.loader.exec_module = executed
        return spec


def _keep_what_numba_compiles():
    watch = _WhenNumbaIsImported()
    if watch.name in sys.modules:
        from himap.core.compiled import keep_ours

        keep_ours(sys.modules[watch.name])
    else:
        sys.meta_path.insert(0, watch)


_keep_what_numba_compiles()
