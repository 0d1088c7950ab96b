"""Sphinx configuration of the documentation; `make docs` builds it, a warning is an error."""

import re

from sphinx.application import Sphinx

from wsp_env import __version__

project = "wsp-env"
author = "The wsp-env authors"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]

html_theme = "alabaster"
html_theme_options = {"description": "A laboratory for railway wheel slide protection", "page_width": "1040px"}

# What an extra brings is not needed to read about it.
autodoc_mock_imports = ["stable_baselines3"]
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the signatures of array functions are long; shapes and units stand in the text
autodoc_default_options = {"members": True, "undoc-members": False}

_PARAMETER = re.compile(r"^(\w+(?:, \w+)*) : (.+)$")


def _prepare(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Move what a docstring says of a parameter from where numpydoc has its type to the line below; escape |e|.

    Blank lines are doubled: that ends a section, so that a paragraph after the parameters is none of them.
    """
    prepared = []
    for line in lines:
        escaped = line.replace("|", r"\|")
        match = _PARAMETER.match(escaped)
        prepared += [match[1], f"    {match[2]}"] if match else [escaped] if line else ["", ""]
    lines[:] = prepared


def setup(app: Sphinx) -> None:
    """Connect what prepares docstrings, before napoleon reads them."""
    app.connect("autodoc-process-docstring", _prepare, priority=100)
