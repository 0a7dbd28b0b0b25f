# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/claims_*.json
#     - book/results/readings*.json
#     - book/results/restarts*.json
#     - book/results/*/figures.json
#     section: "6"
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The answer
#
# > - **Read first**: nothing; the words are in {doc}`../book/glossary`.
# > - **Good to know**: what a power spectrum is.
# > - **Time and memory**: {cost}`00_the_answer`.
#
# **SDecGMCA, the method that {cite:t}`gkogkou2025` is about, is chaotic**: a change of its start in the tenth digit gives another answer, in its authors' public code as here, and no run converges ({doc}`27_restarts`). One run is one draw, so this page states ensembles over skies and restarts. What holds all
# the same, on the real Galaxy at half the paper's resolution (`laptop`) and in the reading that is most charitable to the paper: of the {glue:text}`15_claims.ipynb::claims_sd:s` claims on SDecGMCA {glue:text}`15_claims.ipynb::claims_sd_reproduced:s` are reproduced,
# {glue:text}`15_claims.ipynb::claims_sd_in_part:s` in part, {glue:text}`15_claims.ipynb::claims_sd_undecided:s` are undecided, since it gives now one answer and now another, and {glue:text}`15_claims.ipynb::claims_sd_failed:s` are not; of the {glue:text}`15_claims.ipynb::claims_others:s` others
# {glue:text}`15_claims.ipynb::claims_others_reproduced:s`, {glue:text}`15_claims.ipynb::claims_others_in_part:s`, {glue:text}`15_claims.ipynb::claims_others_undecided:s` and {glue:text}`15_claims.ipynb::claims_others_failed:s`. On data of your own use a method that does not depend on its start, such as BeamSubspace
# ([a table by what you have](what-to-use)); if it is SDecGMCA, run restarts and look at their scatter (the option `--restarts` of `himap clean`).
#
# Below are the paper's five conclusions. Each rests on claims of the ledger, whose readings were written down before their numbers were known ({doc}`15_claims`). It is *reproduced* if all of them are, *in part* if one is at least in part, *not reproduced* if all are that, and *undecided* otherwise.
# The first column of verdicts is of the ensemble ({glue:text}`answer_skies` × {glue:text}`answer_restarts` skies and restarts); the second, at the paper's own size (`nside` 256, 500 channels), is older: one run of another reading, by the parts of claims as they were then.
#
# $C/C_0$ and $P/P_0$ are what a method leaves over the truth (HI plus noise), across the sky and along the line of sight, $k$ is in MHz$^{-1}$; SD is SDecGMCA, PAR and POL are the two fits. A claim may have several parts and its row shows one
# number: it can lie on the paper's side of the limit while another part fails, and the main parts that hold in less than 84 % of the members are below it, with the share in which they do.

# %% tags=["parameters", "hide-input"]
results: str | None = None  # folder of stored results; None: that of the book
large: str = "paper_templates"  # the ledger and the figures at the paper's size
several: str = "claims_laptop"  # the ledger over several skies

# %% tags=["hide-input"]
from pathlib import Path

from IPython.display import Markdown

from himap.app.causes import other_records
from himap.app.stored import RESULTS, read_ledger
from himap.app.stored_tables import angular_ratios, ledgers_table, picture, stored_curves
from himap.figures import plotting, styles
from himap.figures.numbers import quote
from himap.figures.tables import Table
from himap.paper.conclusions import CONCLUSIONS, verdict
from himap.paper.ledger_table import BADGES
from himap.store.provenance import Provenance

folder = Path(results or RESULTS)
ledgers = [read_ledger(folder / f"{name}.json") for name in (several, f"claims_{large}")]
others = other_records(ledgers[0][1], folder)
by_id = [{entry.claim.id: entry for entry in entries} for entries, _ in ledgers]


def percent(ledger, claim):
    """The number of a claim, median over its members, as a percentage to quote."""
    value = 100 * by_id[ledger][claim].values[0]
    return value, 0.02 * value, "%"


quote(
    answer_skies=ledgers[0][0][0].n_skies,
    answer_restarts=ledgers[0][0][0].n_restarts,
    answer_evolving=percent(0, "E2"),
    answer_oscillating=percent(0, "O3"),
)


def of(conclusion, entries):
    """The entries of the claims of a conclusion."""
    return [entries[name] for name in conclusion.claims]


def badge(conclusion, entries):
    """Sign and words of the verdict on a conclusion."""
    found = verdict(of(conclusion, entries))
    return f"{BADGES[found][0]} {found}"


def told(number):
    """The claims of a conclusion, with verdicts and numbers of both ledgers."""
    own = CONCLUSIONS[number - 1]
    return Markdown(ledgers_table(ledgers, lambda entries: entries[0].claim.id in own.claims, others))


# %% tags=["hide-input"]
Table(
    ["", "the paper's conclusion", "at half its size", "at its size, one older run"],
    [
        [f"{n}", one.says, badge(one, by_id[0]), badge(one, by_id[1])]
        for n, one in enumerate(CONCLUSIONS, start=1)
    ],
)

# %% [markdown]
# Both ledgers were measured at the commits that stand under their tables, and the figures at the paper's size at those under them; {doc}`../book/status` says which of them the code has changed since.
#
# The angular spectrum of the residual of each of the six methods at the paper's size, over that of HI and noise; of SDecGMCA it is the older run. The axis of ratios is even near 1 and logarithmic far from it; the grey band is 10 %.

# %% tags=["hide-input"]
angular = stored_curves(large, "fig-results-angular", folder)
made = Provenance.of_stored(ledgers[1][1])

# %% tags=["hide-input"] mystnb={"figure": {"name": "fig-answer-angular", "caption": "C/C0 of six methods through the three beams of the paper, at its size, with the real Galaxy (templates, nside 64): the numbers of the paper's Fig. 1, as ratios. PCA and FastICA coincide."}}
panels = [angular_ratios(curves, title=title) for title, curves in angular.items()]
panels[0]["ylabel"] = styles.AXES["angular"]["ratio_label"]
plotting.stamp(plotting.ratios(panels), f"{made.preset} · {made.galaxy} Galaxy · seed {made.seed}")

# %% [markdown]
# And along the line of sight, as it was drawn when it was measured; the axis of ratios is even, from 0 to 2. A method that ends at some $\ell$ lacks the power beyond, and is compared with all of it.

# %% tags=["hide-input"]
Markdown(picture(large, "fig-results-frequency", folder))

# %% [markdown]
# ## 1. The degraded beam

# %% tags=["hide-input"]
told(1)

# %% [markdown]
# **What fails is the polynomial fit**, and no other method where the claims look ($\ell > 3$, $k_\nu > 0.03$): it leaves foreground in the Galactic plane, which shows as an excess at the lowest $\ell$ and at small $k_\nu$
# ({doc}`07_polynomial`). At still smaller $k_\nu$ every method loses power, as the paper says too.
#
# ## 2. The evolving beam

# %% tags=["hide-input"]
told(2)

# %% [markdown]
# **The order of the methods is the paper's; how far each of them gets is not in every case.** The parametric fit fails, GMCA leaves more than PCA, and SDecGMCA stays near 1 in $C_\ell$. But PCA and FastICA with four components are off at the highest multipoles, by up to
# {glue:text}`answer_evolving` at 95 % of all of them for the worst of the three methods, where the beam that shrinks makes new spectra of the foreground; one component more takes these ({doc}`22_how_many`). The excess of GMCA begins at lower multipoles than in the paper on the real Galaxy.
#
# ## 3. The oscillating beam

# %% tags=["hide-input"]
told(3)

# %% [markdown]
# **With as many components for each as in the paper, and where a run of it does not fail, SDecGMCA is nearest to the truth of the six**: within {glue:text}`answer_oscillating` at 95 % of $10 < \ell < 200$ in the median over members, where the paper has 5 %. What one component more does for PCA, which knows no beam, belongs to it: on the synthetic Galaxy of {doc}`10_results` its mean
# $C/C_0$ at $10 < \ell < 128$ is {glue:text}`10_results.ipynb::results_oscillating_more_fine:s`, and that of SDecGMCA {glue:text}`10_results.ipynb::results_oscillating_sd_fine:s` (median and 16 to 84 % of its restarts). Whether SDecGMCA has a peak near $k_\nu = 0.3$, and an excess at the lowest $\ell$ and $k_\nu$, differs between members: the shares are in the rows above.
# How often it fails is in {doc}`27_restarts`, and which of this depends on what the paper's text leaves open is in {doc}`16_readings`.
#
# ## 4. The number of sources

# %% tags=["hide-input"]
told(4)

# %% [markdown]
# The picture, at the paper's size, is of one run of another reading, with the noise of the instrument in the thresholds, in which each further source only takes HI. In the reading of this page the error falls to its least and rises beyond it, as in the paper ({doc}`11_ns_scan`).

# %% tags=["hide-input"]
Markdown(picture(large, "fig-ns-scan-mse", folder))

# %% [markdown]
# **It is critical.** With too few sources the residual has foreground, with too many it lacks HI, and with ten and more its error rises by orders of magnitude. A method that does not know the beam needs more of them, as the beam makes spectra of its own. How to find the number without the truth, which the paper asks for, is in
# {doc}`22_how_many`.
#
# ## 5. Masks

# %% tags=["hide-input"]
told(5)

# %% tags=["hide-input"]
Markdown(picture(large, "fig-dimmed-spectra", folder))

# %% [markdown]
# **Through the oscillating beam masks help PCA, FastICA and GMCA; for SDecGMCA it depends on the member.** Where a run of it has leaked foreground in the plane, masks take that out; where its residual lacks HI, they do little ({doc}`12_post_masking`, {doc}`13_dimmed_galaxy`). The picture is of the same older run as above.
#
# ## Where to go from here
#
# - Every claim, with its reading and its numbers: {doc}`15_claims`; at the paper's size: {doc}`18_paper_size`.
# - All methods side by side: {doc}`25_side_by_side`; [a table by what you have](what-to-use).
