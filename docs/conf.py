"""Sphinx configuration of the documentation; `make docs` builds it, a warning is an error."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

from wsp_env import __version__

sys.path.insert(0, str(Path(__file__).parent))
import outputs

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


def _run(app: Sphinx, docname: str, content: list[str]) -> None:
    """Show what the commands of a page print today; a page that says something else is a warning."""
    anew = outputs.kept(content[0])
    if outputs.words(anew) != outputs.words(content[0]):
        logging.getLogger(__name__).warning("its outputs are of another version; python docs/outputs.py %s.md", docname)
    content[0] = anew


def setup(app: Sphinx) -> None:
    """Connect what prepares docstrings, before napoleon reads them, and what runs the commands of pages."""
    app.connect("autodoc-process-docstring", _prepare, priority=100)
    app.connect("source-read", _run)
