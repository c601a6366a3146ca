"""Sphinx: `tools/with_ros sphinx-build -W docs docs/_build`."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

from octo_arm_model import __version__
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.settings import ESTIMATOR_PARAMETERS
from octo_arm_model.simulation.simulator import PARAMETERS as SIMULATOR

project = 'octo_arm_model'
author = 'octo_arm_model maintainers'
release = __version__

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon']
myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 3
exclude_patterns = ['_build', '_generated']
# The changelog and the notes for contributors keep their levels.
suppress_warnings = ['myst.header']
html_theme = 'furo'
html_title = f'{project} {release}'
html_static_path = ['static']
html_css_files = ['manual.css']
html_show_copyright = False
html_math_renderer = 'mathml'

autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_type_aliases = {name: name for name in ('ArrayLike', 'FloatArray', 'IntArray')}
napoleon_use_ivar = True


def _row(parameter: Parameter) -> str:
    """Row of a parameter in a Markdown table."""
    value = list(parameter.default or ()) if parameter.is_array else parameter.default
    default = 'empty' if value in ([], '') else f'`{value}`'
    if parameter.default is None:
        default = ', or '.join(['required', *(f'`{name}`' for name in parameter.unless)])
    meaning = parameter.description
    for names, relation in ((parameter.unless, 'not beside'), (parameter.needs, 'only with')):
        if names:
            meaning += f'; {relation} {" or ".join(f"`{name}`" for name in names)}'
    return f'| `{parameter.name}` | {parameter.type_name} | {default} | {meaning} |'


# The manual's tables of parameters are generated from their declarations.
_HEAD = ('| parameter | type | default | meaning |', '| --- | --- | --- | --- |')
_GENERATED = Path(__file__).parent / '_generated'
_GENERATED.mkdir(exist_ok=True)
for _name, _table in (
    ('parameters', PARAMETERS),
    ('simulator_parameters', SIMULATOR),
    ('estimator_parameters', ESTIMATOR_PARAMETERS),
):
    _rows = (*_HEAD, *map(_row, _table), '')
    (_GENERATED / f'{_name}.md').write_text('\n'.join(_rows), encoding='utf-8')


def _math(is_block: bool) -> tuple[Callable[[Any, nodes.Node], None], None]:
    """Write a formula as MathML, which browsers draw without fetching anything."""

    def visit(writer: Any, node: nodes.Node) -> None:
        writer.body.append(tex2mathml(node.astext(), as_block=is_block))
        raise nodes.SkipNode

    return visit, None


def _plain_names(
    app: Sphinx, what: str, name: str, obj: object, options: object, signature: str, returns: str
) -> tuple[str, str]:
    """Show aliases of types by their names alone."""
    return signature, re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r'\1', returns or '')


def setup(app: Sphinx) -> None:
    """Register what writes formulas and signatures."""
    app.connect('autodoc-process-signature', _plain_names)
    app.add_html_math_renderer('mathml', _math(False), _math(True))
