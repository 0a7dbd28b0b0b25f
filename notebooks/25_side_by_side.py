# ---
# jupyter:
#   himap:
#     figures: []
#     reads:
#     - book/results/side_by_side_quick_synthetic.json
#     - book/results/side_by_side_quick_templates.json
#     section: ''
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
# # What should I use on my data?

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
survey: dict = {}  # Survey fields that differ from the preset
galaxy: str = "synthetic"  # synthetic, templates or pysm3
template_dir: str | None = None  # folder of FITS templates, for galaxy = templates
small_scales: bool = True  # add structure beyond the resolution of the templates
ripple: str = "bracket"  # reading of the ripple: bracket, additive or additive_strong
beams: list = ["degraded", "evolving", "oscillating"]  # of the data, by name
methods: list = [
    ["sdecgmca", [3, 4, 5]],
    ["pca", [3, 4, 5]],
    ["pca", [3, 5, 6]],
    ["beam_subspace", 3],
    ["smooth_spectra", 4],
    ["gnilc", None],
]  # pairs of a name and a number of sources, or one for each beam
corrected: list = ["pca", "beam_subspace", "smooth_spectra"]  # by mocks, in the record
n_mocks: int = 3  # mocks, each with a seed of its own, of `himap record side-by-side`
reading: str = "default"  # SDecGMCA: default, letter, code or follow-up
results: list | None = None  # what `himap record side-by-side` wrote; null: that of the book
