"""The whole paper at its own size, from nothing: seconds and memory of each command, and of all.

    python -m benchmarks.whole --galaxy templates --template-dir FOLDER --jobs 2 -o whole.json

The light cone, three observations, all methods, ensembles of SDecGMCA through the three beams and with the
plane dimmed, the scan with one start, masks, the ledger with one start, and every figure. The cache is a
folder of its own, in the temporary folder of the machine, that is removed: some 50 GB at the paper's size.
Notebooks and ledger stay if they get a folder.
"""

import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import click

from benchmarks.measure import Benchmark, peak_memory, write_result
from himap.core.survey import PRESETS, Survey
from himap.sky.galaxy import SOURCES, Galaxy
from himap.store.provenance import Provenance

COMMANDS = {
    "ensembles, masks, diagnostics": "run 10_results 12_post_masking 13_dimmed_galaxy 14_diagnostics "
    "-p n_restarts={n_restarts}",
    "scan": "run 11_ns_scan -p n_restarts=1",
    "peak masking": "run 03_peak_masking",
    "ledger": "measure claims -p n_realisations=1 -p n_restarts=1 -p n_sources_max=8 -o ledger.json",
}


@click.command(cls=Benchmark)
@click.option("--preset", type=click.Choice(list(PRESETS)), default="paper", show_default=True)
@click.option("--galaxy", type=click.Choice(SOURCES), default="synthetic", show_default=True)
@click.option("--template-dir", type=click.Path(exists=True, resolve_path=True), help="Of the templates.")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True, help="Processes at once.")
@click.option("--n-restarts", type=click.IntRange(1), default=8, show_default=True, help="Of an ensemble.")
@click.option("--folder", type=click.Path(file_okay=False), help="For the notebooks and the ledger.")
@click.option("-o", "--output", metavar="FILE", type=click.Path(dir_okay=False), help="JSON file to write.")
def main(preset, galaxy, template_dir, jobs, n_restarts, folder, output):
    """Time the whole paper, and the memory of its processes."""
    given = {"galaxy": Galaxy(source=galaxy, template_dir=template_dir), "preset": preset}
    given["parameters"] = {"jobs": jobs, "n_restarts": n_restarts}
    options = ["--preset", preset, "-p", f"galaxy={galaxy}", "--jobs", str(jobs)]
    options += ["-p", f"template_dir={template_dir}"] if template_dir else []
    started, rows = time.monotonic(), []
    with tempfile.TemporaryDirectory() as temporary_folder:
        cache, place = Path(temporary_folder, "cache"), Path(folder or temporary_folder)
        place.mkdir(parents=True, exist_ok=True)
        if (place / "ledger.json").exists():
            raise click.ClickException(f"{place / 'ledger.json'} exists; give another --folder.")
        for name, command in COMMANDS.items():
            words = command.format(n_restarts=n_restarts).split()
            rows.append({"step": name} | _run([*words, *options], place, cache))
            click.echo(f"{name:32}{rows[-1]['seconds']:7.0f} s {rows[-1]['memory_gb']:6.1f} GB")
            seconds, memory = sum(row["seconds"] for row in rows), max(row["memory_gb"] for row in rows)
            about = asdict(Provenance.of(Survey.preset(preset), **given, started=started))
            stored = {"about": about, "commands": rows, "seconds": seconds, "memory_gb": memory}
            write_result(output, stored)  # after each, for the next may fail
    click.echo(f"{'all':32}{seconds:7.0f} s {memory:6.1f} GB")


def _run(arguments, folder, cache):
    """{"seconds", "memory_gb"} of a himap command in a folder, with a cache of its own."""
    variables = os.environ | {"HIMAP_CACHE": str(cache), "PYTHONPATH": os.pathsep.join(sys.path)}
    started = time.monotonic()
    with subprocess.Popen([sys.executable, "-m", "himap", *arguments], cwd=folder, env=variables) as process:

        def ended(seconds):
            with suppress(subprocess.TimeoutExpired):
                process.wait(seconds)
            return process.returncode is not None

        memory = peak_memory(process.pid, ended)
    if process.returncode:
        failed = f"himap {' '.join(arguments)} ended with {process.returncode}"
        raise click.ClickException(f"{failed}, as said above.")
    return {"seconds": time.monotonic() - started, "memory_gb": memory / 1e9}


if __name__ == "__main__":
    main()
