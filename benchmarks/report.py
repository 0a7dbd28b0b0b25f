"""The tables of the page on scale, from the files that the benchmarks wrote.

    python -m benchmarks.report

In `book/scale.md`, what stands between ``<!-- begin NAME -->`` and the next ``<!-- end -->`` is replaced.
"""

import json
import re
from pathlib import Path

import click

PAGE = Path(__file__).resolve().parents[1] / "book" / "scale.md"
RESULTS = PAGE.parent / "results"
_BLOCK = re.compile(r"(<!-- begin (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)
_BIG = {"nside": 512, "n_channels": 2000}
_REALISATIONS = 100


def read(name):
    """The contents of `name`.json among the results of the book."""
    return json.loads((RESULTS / f"{name}.json").read_text())


def table(header, rows):
    """A Markdown table of texts; all columns but the first to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def machine(preset):
    """What the machine could do when `preset` was measured."""
    found = read(f"steps_{preset}")["machine"]
    return (
        f"The machine: {found['bandwidth'] / 1e9:.3g} GB/s, {found['operations'] / 1e9:.3g} GFlop/s "
        f"({found['operations_single'] / 1e9:.3g} in float32), a transform in "
        f"{1e3 * found['transform']:.3g} ms ({1e3 * found['transform_single']:.3g} in float32).\n"
    )


def steps(preset):
    """Time, memory, floor and alternative of every step."""
    rows = []
    for row in read(f"steps_{preset}")["steps"]:
        beside = row.get("alternative")
        goal = f" ({row['goal_seconds']} s, {row['goal_gb']} GB)" if preset == "paper" else ""
        rows.append(
            (
                row["step"] + goal,
                f"{row['seconds']:.3g} s",
                f"{row['memory_gb']:.1f} GB",
                f"{row['floor_seconds']:.2g} s",
                f"{row['seconds'] / row['floor_seconds']:.2g}",
                f"{beside['name']}: {beside['seconds'] / row['seconds']:.2g}" if beside else "",
            )
        )
    header = ("step", "time", "memory", "floor", "time / floor", "alternative: its time / ours")
    return table(header, rows)


def exponents():
    """How every step grows."""
    found = read("scaling")["found"]
    rows = [
        (step, f"{found['nside'][step]['exponent']:.2f}", f"{found['n_channels'][step]['exponent']:.2f}")
        for step in found["nside"]
    ]
    return table(("step", "with nside (the box too)", "with channels"), rows)


def cluster(preset):
    """What a large survey would cost, from the times at `preset` and the exponents."""
    found, measured = read("scaling")["found"], read(f"steps_{preset}")
    size = dict(measured["about"]["size"])
    rows, total = [], 0
    for row in measured["steps"]:
        growth = 1
        for name, big in _BIG.items():
            growth *= (big / size[name]) ** found[name][row["step"]]["exponent"]
        hours = row["seconds"] * growth * _REALISATIONS / 3600
        total += hours
        rows.append((row["step"], f"{growth:.2g}", f"{row['seconds'] * growth / 60:.2g}", f"{hours:.2g}"))
    rows.append(("all of them", "", "", f"{total:.2g}"))
    return table(("step", "growth", "minutes for one", f"hours for {_REALISATIONS}"), rows)


def filled(page):
    """The text of the page with its tables made again."""
    makers = {"machine": machine, "steps": steps, "exponents": exponents, "cluster": cluster}

    def block(match):
        maker, _, argument = match[2].partition(":")
        return match[1] + makers[maker](*filter(None, [argument])) + match[3]

    return _BLOCK.sub(block, page)


@click.command()
def main():
    """Fill in the tables of the page."""
    PAGE.write_text(filled(PAGE.read_text()))


if __name__ == "__main__":
    main()
