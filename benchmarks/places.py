"""A place of its own for a command that will be killed: folders, processes, and what is left in them."""

import hashlib
import json
import os
import re
import resource
import subprocess
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

import psutil

from himap.app.notebooks import notebooks_folder
from himap.store.provenance import VOLATILE

_SHARED_MEMORY = Path("/dev/shm")
_PATIENCE = 20  # s in which processes notice that the one that started them is gone


class Place:
    """Folders for work, cache and temporary files below `folder`, which is made."""

    def __init__(self, folder):
        self.folder, self.errors = folder, folder / "errors.txt"
        for name in ("work", "cache", "tmp"):
            (folder / name).mkdir(parents=True, mode=0o700)
        (folder / "work" / "notebooks").symlink_to(notebooks_folder())
        self._shared = _shared_memory()

    def start(self, words, *, largest=None):
        """A `Popen` of `himap` with these words, whose files may not grow beyond `largest` bytes."""
        changes = {"HIMAP_CACHE": "cache", "TMPDIR": "tmp"}
        environment = os.environ | {name: str(self.folder / path) for name, path in changes.items()}
        limit = (largest, largest)
        with self.errors.open("wb") as errors:
            return subprocess.Popen(
                [sys.executable, "-m", "himap", *words],
                cwd=self.folder / "work",
                env=environment | {"PYTHONPATH": os.pathsep.join(sys.path)},
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
                preexec_fn=largest and (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit)),
            )

    def processes(self, word=""):
        """What runs here, by the folder of its temporary files, with `word` in its command line.

        That of processes that joblib started to share the work of another has "popen_loky".
        """
        found = []
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                is_here = process.environ().get("TMPDIR") == str(self.folder / "tmp")
                if is_here and word in " ".join(process.cmdline()):
                    found.append(process)
        return found

    def gone(self):
        """How many processes are left when they had time to end; these are ended."""
        deadline = monotonic() + _PATIENCE
        while (left := self.processes()) and monotonic() < deadline:
            sleep(0.1)
        for process in left:
            with suppress(psutil.Error):
                process.kill()
        return len(left)

    def results(self):
        """{name: digest} of what was written, times aside; of what is cached, checksums of files."""
        work, cache = self.folder / "work", self.folder / "cache"
        files = [path for path in (*work.glob("*"), *work.glob("results/*")) if path.is_file()]
        found = {str(path.relative_to(work)): _digest(path) for path in files}
        for note in cache.glob("*/[0-9a-f]*/note.json"):
            found["/".join(note.parts[-3:-1])] = json.loads(note.read_text())["files"]
        return found

    def left(self):
        """`Counter` of what lies about and should not."""
        work, cache, temporary = (self.folder / name for name in ("work", "cache", "tmp"))
        return +Counter(
            {
                "beside_outputs": sum(1 for _ in work.rglob(".himap-*")),
                "in_the_cache": sum(1 for _ in cache.glob("*/unfinished-*")),
                "in_temporary_folders": sum(1 for _ in temporary.iterdir()),
                "in_shared_memory": len(_shared_memory() - self._shared),
            }
        )


def _shared_memory():
    """What joblib has there of processes that are no more: it names them."""
    names = [path.name for path in _SHARED_MEMORY.iterdir()] if _SHARED_MEMORY.is_dir() else []
    owners = {name: re.search(r"(?:loky-|folder_)(\d+)", name) for name in names}
    return {name for name, pid in owners.items() if pid and not psutil.pid_exists(int(pid[1]))}


def _digest(path):
    content = path.read_bytes()
    if path.suffix == ".ipynb":
        cells = json.loads(content)["cells"]
        content = [[cell["source"], *map(_numbers, cell.get("outputs", []))] for cell in cells]
    elif path.suffix == ".json":
        content = json.loads(content)["rows"]
    if not isinstance(content, bytes):
        content = re.sub(VOLATILE, "", json.dumps(content, ensure_ascii=False)).encode()
    return hashlib.sha256(content).hexdigest()


def _numbers(output):
    """An output without its picture, in which the time is drawn; the numbers of the picture stay."""
    data = {kind: value for kind, value in output.get("data", {}).items() if kind != "image/png"}
    return output | {"data": data}
