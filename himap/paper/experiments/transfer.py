"""How well spectra of residuals are corrected, and how often their error bars cover the truth."""

from dataclasses import replace

import numpy as np
from scipy import stats

from himap.core.checks import whole_number
from himap.measures.transfer import MOST, TransferFunction, agreeing, sigma
from himap.paper.grid import (
    band_rows,
    cases_and_methods,
    make_products,
    method_columns,
    skies_of,
    summarise,
)
from himap.paper.mocks import mocks_of_sky, own_recovery, resampled
from himap.paper.record import Experiment
from himap.removal.cleaning import one_more

COLUMNS = {
    "method": str,
    "n_sources": int,  # 0 of a method that has none
    "band": str,
    "n_used": int,
    "uncorrected": float,
    "corrected": float,
    "error_bar": float,
    "foreground": float,
    "systematic": float,
}
"""Power over that of the truth, mean in a band such as "C/C0, 10-19": of the residual, and `corrected`, with
the number of sources `n_used` (`measure`). `error_bar` is the scatter of `corrected` over the members of the
bootstrap; `foreground` what the same correction with `n_sources` has more, which is foreground residual; and
`systematic` what `corrected` has more than the correction with one source more."""


def skies(*, n_mocks=8, **settings):
    """A list of `Sky`, each with two mocks or more that no other sky has.

    Parameters and errors as of `cases_and_methods`.
    """
    whole_number("n_mocks", n_mocks, 2, 1000)  # one mock has no scatter
    several = skies_of(cases_and_methods(**settings))
    return [replace(sky, mocks=mocks_of_sky(sky.survey.seed, n_mocks)) for sky in several]


def measure(sky):
    """Ratios to the truth, corrections and error bars in each band, of each method of a `Sky`.

    Of each method residuals with its own number of sources, one more and so on are corrected, until two that
    follow each other agree (`agreeing`), or there are `MOST`. The last but one counts.
    """
    pairs = [(case, remover) for case, removers in sky.methods.items() for remover in removers]
    chains = {pair: [] for pair in pairs}
    going = {pair: [pair[1], one_more(pair[1])] for pair in pairs}
    while going:
        wanted = dict.fromkeys((case, one) for (case, _), further in going.items() for one in further)
        make_products(
            [(resampled, (*pair, mock)) for pair in wanted for mock in sky.mocks]
            + [(own_recovery, pair) for pair in wanted]
        )
        for (case, remover), further in going.items():
            for one in further:
                transfer = TransferFunction(mocks=tuple(resampled(case, one, mock) for mock in sky.mocks))
                chains[case, remover].append((one, corrected_bands(own_recovery(case, one), transfer)))
        going = {
            pair: [one_more(chain[-1][0])]
            for pair, chain in chains.items()
            if not agreeing(*(_corrected(rows) for _, rows in chain[-2:])) and len(chain) < MOST
        }
    return [method_columns(remover) | row for (_, remover), chain in chains.items() for row in _rows(chain)]


def _corrected(rows):
    return np.array([(row["corrected"], row["error_bar"]) for row in rows]).T


def _rows(chain):
    """The rows of a method from those with more and more sources."""
    (_, own), (remover, used), (_, more) = chain[0], *chain[-2:]
    return [
        first
        | {name: row[name] for name in ("corrected", "error_bar")}
        | {"n_used": getattr(remover, "n_sources", 0), "foreground": first["corrected"] - row["corrected"]}
        | {"systematic": row["corrected"] - last["corrected"]}
        for first, row, last in zip(own, used, more, strict=True)
    ]


def corrected_bands(power, transfer):
    """Rows of one method, from the `MockPower` of the truth and a `TransferFunction` of two mocks or more."""
    corrected = {}
    for kind in ("angular", "frequency"):
        true, left = (getattr(part, kind) for part in (power.input, power.output))
        corrected[kind] = np.r_[np.nan, transfer.corrected(kind, left)[1:] / true[1:]]
    errors = power.band_means({kind: transfer.errors(kind) for kind in corrected})
    rows = band_rows(power, uncorrected=power.ratios(), corrected=corrected)
    return [row | {"error_bar": float(sigma(errors[row["band"]]))} for row in rows]


def coverage(table):
    """How often the truth is within the error bar, (hits, trials, lower and upper end of a 95 % interval).

    The interval is that of Clopper & Pearson (1934). Each row is a trial, although bands of one sky are not
    independent: it is rather too narrow.
    """
    hits, trials = int(((table["corrected"] - 1).abs() < table["error_bar"]).sum()), len(table)
    low = stats.beta.ppf(0.025, hits, trials - hits + 1) if hits else 0.0
    high = stats.beta.ppf(0.975, hits + 1, trials - hits) if hits < trials else 1.0
    return hits, trials, float(low), float(high)


def chi_squared(table):
    """Mean of ((corrected - truth) / error bar)^2, which is 1 of true error bars."""
    return float((((table["corrected"] - 1) / table["error_bar"]) ** 2).mean())


def _summary(table):
    """Means over skies for each method and band, and on how many skies the truth is within the error bar."""

    def mean(column):
        return lambda group: f"{group[column].mean():.4f}"

    def within(group):
        hits, trials, low, high = coverage(group)
        return f"{hits} of {trials} ({100 * low:.0f} to {100 * high:.0f} %)"

    cells = {
        "method": "method",
        "band": "band",
        "uncorrected": mean("uncorrected"),
        "corrected": mean("corrected"),
        "sources": lambda group: " to ".join(map(str, sorted({*group["n_used"].agg(["min", "max"])}))),
        "scatter": lambda group: f"{group['corrected'].std():.4f}",
        "error bar": mean("error_bar"),
        "foreground": mean("foreground"),
        "systematic": mean("systematic"),
        "within 1σ": within,
        "χ²": lambda group: f"{chi_squared(group):.2f}",
    }
    return summarise(table, ["method", "n_sources", "band"], cells)


EXPERIMENT = Experiment(
    name="transfer",
    chapter="20_transfer_function",
    columns=COLUMNS,
    key=("method", "n_sources"),
    skies=skies,
    measure=measure,
    summary=_summary,
    defaults={
        "n_mocks": 8,
        "methods": [["beam_subspace", 3], ["beam_subspace", 4], ["pca", 6], ["pca", 7]],
    },
    without=("results", "larger"),
    stated=("n_realisations", "n_mocks"),
)
