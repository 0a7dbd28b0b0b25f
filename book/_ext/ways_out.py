"""Sphinx extension: one setting, ``repository: url`` in ``_config.yml``, turns on the buttons that lead to
the source, edit it, open an issue, and open a notebook in Binder or Colab. While it is empty there are none.
"""

SOURCES = ("repository", "source", "edit_page", "issues")
LAUNCHERS = {
    "binderhub_url": "https://mybinder.org",
    "colab_url": "https://colab.research.google.com",
    "notebook_interface": "jupyterlab",
}


def turn_on(app, config):
    options = config.html_theme_options
    if options.get("repository_url"):
        options |= {f"use_{name}_button": True for name in SOURCES}
        options["launch_buttons"] = LAUNCHERS


def setup(app):
    app.connect("config-inited", turn_on, priority=10)  # before the theme reads its options
    return {"parallel_read_safe": True, "parallel_write_safe": True}
