"""Work that is killed, that several processes share, or that a full disk ends: what is lost, counted.

    python -m benchmarks.endurance -o book/results/endurance.json

`himap run`, `claims` and `clean` get SIGKILL at random points, alone or with all their processes, and are
started again until they are done. Then everything is held against an undisturbed run, bit by bit, and what
lies about in folders, in shared memory and among processes is counted. The book's chapter on scale shows it.
"""

import json
import os
import random
import shutil
import signal
import tempfile
from collections import Counter
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from time import monotonic, sleep

import click
import h5py
import numpy as np
import psutil

from benchmarks.measure import Benchmark, write_result
from benchmarks.places import Place
from himap.core.survey import PRESETS
from himap.store.provenance import Provenance

_N_CHANNELS, _NSIDE = 40, 32  # of the cube that is cleaned
_RUN = "run 04_pca --preset ci"
_CLAIMS = "measure claims --preset ci -p n_realisations=1 -p n_restarts=1 -p n_sources_max=5 --jobs 2"
_CLEAN = "clean cube.h5 --method pca -p n_sources=2 -o cleaned.fits"


class Trial:
    """One command, the words after `himap`, and what an undisturbed run of it gives and takes.

    Its places are in a folder of that name in the folder `home`.
    """

    def __init__(self, name, words, home):
        self.words, self.home = words, home / name
        self.counts, self._n = Counter(), 0
        place, started = self.place(), monotonic()
        if place.start(words).wait():
            raise click.ClickException(place.errors.read_text())
        self.seconds, self.expected = monotonic() - started, place.results()

    def place(self):
        """A new `Place`, with the cube that is cleaned."""
        self._n += 1
        place = Place(self.home / str(self._n))
        freqs, rng = np.linspace(900, 1400, _N_CHANNELS), np.random.default_rng(1)
        maps = (freqs[:, None] / 900) ** -2.7 * rng.lognormal(size=12 * _NSIDE**2) * 1e3
        with h5py.File(place.folder / "work" / "cube.h5", "w") as file:
            file["maps"], file["freqs"] = maps + 0.1 * rng.standard_normal(maps.shape), freqs
            file.attrs.update(unit="mK", ordering="RING")
        return place

    def finish(self, place):
        """Run the command to its end, compare, count, and throw the place away."""
        if not self.is_done(place):
            code = place.start(self.words).wait()
            self.counts["reruns_that_failed"] += code != 0
        self.counts["other_results"] += not self.is_done(place)
        self.counts["processes_left"] += place.gone()
        self.counts += Counter({f"left_{name}": n for name, n in place.left().items()})
        self.counts["finished"] += 1
        shutil.rmtree(place.folder)

    def is_done(self, place):
        """Whether all is there, of the same bits."""
        found = place.results()
        return all(found.get(name) == digest for name, digest in self.expected.items())


def kill(trial, n_kills, chance):
    """Kill the command at random points until it was killed `n_kills` times."""
    place = trial.place()
    while trial.counts["kills"] < n_kills:
        process = place.start(trial.words)
        deadline = monotonic() + chance.uniform(0, trial.seconds)
        while process.poll() is None and monotonic() < deadline:
            sleep(0.001)
        if process.poll() is None:
            alone = chance.random() < 0.5
            process.kill() if alone else os.killpg(process.pid, signal.SIGKILL)
            trial.counts["kills"] += process.wait() == -signal.SIGKILL
            trial.counts["processes_left"] += place.gone()
        elif process.returncode and not trial.is_done(place):
            trial.counts["reruns_that_failed"] += 1
        if process.returncode == 0 or trial.is_done(place):
            trial.finish(place)
            place = trial.place()
    trial.finish(place)


def share(trial, n_processes, chance):
    """Several at once on one cold cache, of which one is killed."""
    place = trial.place()
    outputs = [[*trial.words, "-o", f"{n}.ipynb"] for n in range(n_processes)]
    processes = [place.start(words) for words in outputs]
    sleep(chance.uniform(0, trial.seconds))
    os.killpg(processes[0].pid, signal.SIGKILL)
    trial.counts["processes_that_failed"] = sum(process.wait() != 0 for process in processes[1:])
    found = place.results()
    copies = [found.get(f"{n}.ipynb") for n in range(1, n_processes)]
    trial.counts["other_results"] += sum(copy not in trial.expected.values() for copy in copies)
    trial.counts["processes"] = n_processes
    trial.finish(place)


def fill_disk(trial, n_times, chance):
    """No file may grow beyond a random size, which simulates a full disk.

    Standard error goes to a file too, and what is said before the disk is full has to fit.
    """
    for _ in range(n_times):
        place = trial.place()
        process = place.start(trial.words, largest=int(10 ** chance.uniform(3, 6)))
        trial.counts["full_disks"] += 1
        _count_end(trial, place, process, "Error: ")


def kill_workers(trial, n_times, chance):
    """One of the processes that share the work of a command dies."""
    for _ in range(n_times):
        place, workers = trial.place(), []
        process = place.start(trial.words)
        deadline = monotonic() + chance.uniform(0.2, 0.9) * trial.seconds
        while process.poll() is None and not workers:
            sleep(0.05)
            workers = place.processes("popen_loky") if monotonic() > deadline else []
        if workers:
            with suppress(psutil.Error):
                chance.choice(workers).kill()
                trial.counts["workers_killed"] += 1
        _count_end(trial, place, process, "processes died")


def _count_end(trial, place, process, words):
    """How a command ended that cannot have what it needs: it says these words, or does not."""
    code, said = process.wait(), place.errors.read_text(errors="replace")
    trial.finish(place)  # first, for it drops counts of zero
    trial.counts["told_in_a_sentence"] += code == 2 and words in said and "Traceback" not in said
    trial.counts["done_all_the_same"] += code == 0


def _about(pairs, started):
    made = Provenance.of(PRESETS["ci"], galaxy="synthetic", preset="ci", started=started)
    return asdict(made) | {"overrides": [pair.split("=", 1) for pair in pairs]}


_TRIALS = {
    "run_killed": (_RUN, kill),
    "claims_killed": (_CLAIMS, kill),
    "clean_killed": (_CLEAN, kill),
    "four_processes": (_RUN, share),
    "full_disk_run": (_RUN, fill_disk),
    "full_disk_clean": (_CLEAN, fill_disk),
    "dead_worker": (_CLAIMS, kill_workers),
}
"""{name: (command, what disturbs it)}"""


@click.command(cls=Benchmark)
@click.option("--kills", default=100, show_default=True, help="SIGKILLs, a third of them for each command.")
@click.option("-p", "pairs", multiple=True, metavar="NAME=VALUE", help="A field of the survey.")
@click.option("--only", multiple=True, type=click.Choice(list(_TRIALS)), help="The file keeps the others.")
@click.option("--seed", default=1, show_default=True, help="Of the random points.")
@click.option("-o", "--output", metavar="FILE", type=click.Path(dir_okay=False), help="JSON file to write.")
def main(kills, pairs, only, seed, output):
    """Kill, share and fill, and count what is lost."""
    chance, fields = random.Random(seed), [word for pair in pairs for word in ("-p", pair)]
    few = max(1, kills // 10)
    times = {kill: -(-kills // 3), share: 4, fill_disk: few, kill_workers: max(1, few // 3)}
    is_more = only and output and Path(output).exists()
    stored = json.loads(Path(output).read_text()) if is_more else {"found": {}, "about": {}}
    found, before = stored["found"], stored["about"]
    started = monotonic() - before.get("seconds", 0)
    now, then = (json.dumps(about | {"seconds": 0}) for about in (_about(pairs, started), before))
    if before and now != then:
        raise click.ClickException(f"{output} is of other parameters, code or packages; leave out --only.")
    with tempfile.TemporaryDirectory(prefix="e") as home:
        for name, (command, disturb) in _TRIALS.items():
            if only and name not in only:
                continue
            trial = Trial(name, command.split() + (command != _CLEAN) * fields, Path(home))
            disturb(trial, times[disturb], chance)
            found[name] = {"undisturbed_seconds": trial.seconds, **dict(trial.counts)}
            click.echo(f"{name}: {found[name]}")
            write_result(output, {"about": _about(pairs, started), "found": found})  # the next takes long


if __name__ == "__main__":
    main()
