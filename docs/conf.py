"""Sphinx: `tools/with_ros sphinx-build -W docs docs/_build`."""

from pathlib import Path

from octo_arm_model import __version__
from octo_arm_model.parameters import PARAMETERS, as_markdown

project = 'octo_arm_model'
author = 'octo_arm_model maintainers'
release = __version__

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon']
myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 3
exclude_patterns = ['_build', '_generated']
# Sections of the README keep their level.
suppress_warnings = ['myst.header']
html_theme = 'alabaster'
html_static_path: list[str] = []
html_theme_options = {'page_width': '1100px', 'description': project}

autodoc_member_order = 'bysource'
autodoc_typehints = 'description'
autodoc_typehints_description_target = 'documented'
# Arrays are arrays of float64; the docstrings say of which shape.
autodoc_type_aliases = {'FloatArray': 'FloatArray', 'ArrayLike': 'ArrayLike'}
napoleon_use_ivar = True

# The table that declares the parameters is the one that documents them.
_GENERATED = Path(__file__).parent / '_generated'
_GENERATED.mkdir(exist_ok=True)
(_GENERATED / 'parameters.md').write_text(as_markdown(PARAMETERS), encoding='utf-8')
