"""``octo-arm reproduce``: the paper's figures, tables and claims, computed anew."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from octo_arm_model.cli.progress import Bar
from octo_arm_model.reproduce.claims.all_claims import CLAIMS
from octo_arm_model.reproduce.page.document import Block, Picture

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

_DESCRIPTION = """\
Compute the paper's figures and tables anew and check the claims of its text, with all three
models, and write them on one page: OUTDIR/renda2012.html, which needs no other file and no
network. A browser prints it on A4. Takes about five seconds; needs matplotlib.
"""
_EPILOG = """\
example:
  octo-arm reproduce reproduced

exit status: 0 all claims hold for the paper's own model, 1 one does not, 2 the input is wrong
"""


def add_command(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the command to the subparsers ``commands``."""
    parser = commands.add_parser(
        'reproduce',
        help="compute the paper's figures, tables and claims anew, on one page",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('outdir', metavar='OUTDIR', type=Path, help='folder for the page')
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    # Before the work and not after it: is there what draws, and somewhere to write?
    from octo_arm_model.reproduce.page import content
    from octo_arm_model.reproduce.page.html_page import as_html

    options.outdir.mkdir(parents=True, exist_ok=True)
    claims = [claim() for claim in CLAIMS]
    bar = Bar(sys.stderr, 'pictures')
    blocks = _counting(content.blocks(claims), bar)
    html = options.outdir / 'renda2012.html'
    html.write_text(as_html(blocks), encoding='utf-8')
    bar.leave()
    print(html, content.summary(claims), sep='\n')
    failed = [claim for claim in claims if claim.fails]
    for claim in failed:
        print(f'octo-arm: does not hold: {claim.says} ({claim.where})', file=sys.stderr)
    return 1 if failed else 0


def _counting(blocks: Sequence[Block], bar: Bar) -> list[Block]:
    """``blocks``, whose pictures move the ``bar`` when they are drawn: all else takes no time."""
    total = sum(isinstance(block, Picture) for block in blocks)
    numbers = itertools.count(1)

    def counting(picture: Picture) -> Picture:
        def draw(figure: FigureBase) -> None:
            picture.draw(figure)
            bar(next(numbers), total)

        return dataclasses.replace(picture, draw=draw)

    return [counting(block) if isinstance(block, Picture) else block for block in blocks]
