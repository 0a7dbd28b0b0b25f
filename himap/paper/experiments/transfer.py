"""How well spectra of residuals are corrected, and how often their error bars cover the truth."""

from dataclasses import replace

import numpy as np
from scipy import stats

from himap.core.checks import whole_number
from himap.measures.bootstrap import KINDS, sigma
from himap.paper import grid
from himap.paper.mocks import bootstrap, mocks_of_sky, own_recovery, resampled
from himap.paper.record import Experiment
from himap.removal.cleaning import one_more
from himap.store.store import product

MOST = 4
"""How many numbers of sources are tried, one after the other, until no foreground residual is detected."""

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
`systematic` what `corrected` has more than the correction by the same members with one source more."""


def skies(*, n_mocks=8, **settings):
    """A list of `Sky`, each with two mocks or more that no other sky has.

    Parameters and errors as of `cases_and_methods`.
    """
    whole_number("n_mocks", n_mocks, 2, 1000)  # one mock has no scatter
    several = grid.skies_of(grid.cases_and_methods(**settings))
    return [replace(sky, mocks=mocks_of_sky(sky.survey.seed, n_mocks)) for sky in several]


@product(name="measured_transfer")
def measure(sky):
    """Ratios to the truth, corrections and error bars in each band, of each method of a `Sky`.

    Of each method residuals with its own number of sources, one more and so on are corrected, until the
    foreground that was found explains what the next source takes (`Bootstrap.explains`), or there are `MOST`.
    """
    chains = {(case, remover): [] for case, removers in sky.methods.items() for remover in removers}
    going = {pair: pair[1] for pair in chains}
    while going:
        wanted = dict.fromkeys((case, one) for (case, _), one in going.items())
        further = dict.fromkeys((case, method) for case, one in wanted for method in (one, one_more(one)))
        grid.make_products(
            [(resampled, (*pair, mock)) for pair in wanted for mock in sky.mocks]
            + [(own_recovery, pair) for pair in further]
        )
        explained = []
        for (case, remover), one in going.items():
            found, powers = bootstrap(case, one, sky.mocks), [own_recovery(case, one)]
            powers.append(own_recovery(case, one_more(one)))
            chains[case, remover].append((one, *corrections(*powers, found)))
            if found.explains(*(power.output for power in powers)):
                explained.append((case, remover))
        going = {
            pair: one_more(one)
            for pair, one in going.items()
            if pair not in explained and len(chains[pair]) < MOST
        }
    return [
        grid.method_columns(remover) | row
        for (_, remover), chain in chains.items()
        for row in in_bands(chain)
    ]


def corrections(power, power_more, members):
    """Rows of `corrected_bands`, and those with one source more, of the `MockPower` of a truth."""
    return corrected_bands(power, members.own), corrected_bands(power_more, members.more)


def in_bands(chain):
    """The rows of a method from those with more and more sources, (method, *`corrections`) each."""
    (_, first, _), (remover, last, more) = chain[0], chain[-1]
    return [
        own
        | {name: used[name] for name in ("corrected", "error_bar")}
        | {"n_used": getattr(remover, "n_sources", 0), "foreground": own["corrected"] - used["corrected"]}
        | {"systematic": used["corrected"] - beyond["corrected"]}
        for own, used, beyond in zip(first, last, more, strict=True)
    ]


def corrected_bands(power, transfer):
    """Rows of one method, from the `MockPower` of the truth and a `TransferFunction` of two mocks or more."""
    corrected = {}
    for kind in KINDS:
        true, left = (getattr(part, kind) for part in (power.input, power.output))
        corrected[kind] = np.r_[np.nan, transfer.corrected(kind, left)[1:] / true[1:]]
    errors = power.band_means({kind: transfer.errors(kind) for kind in corrected})
    rows = grid.band_rows(power, uncorrected=power.ratios(), corrected=corrected)
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
    return grid.summarise(table, ["method", "n_sources", "band"], cells)


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
