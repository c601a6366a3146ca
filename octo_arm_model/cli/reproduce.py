"""``octo-arm reproduce``: the paper's figures, tables and claims, computed anew."""

import argparse
import sys

from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, writing
from octo_arm_model.reproduce.claims import CLAIMS

SUMMARY = "compute the paper's figures, tables and claims anew, on one page"
DESCRIPTION = """\
Compute the paper's figures and tables anew and check the claims of its text, with all three
models, and write them on one page: OUTDIR/renda2012.html, which needs no other file and no
network. A browser prints it on A4. Takes about five seconds; needs matplotlib.
"""
EPILOG = """\
example:
  octo-arm reproduce reproduced

exit status: 0 all claims hold for the paper's own model, 1 one does not, 2 the input is wrong
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    arguments.add_path(parser, 'outdir', 'OUTDIR', 'folder for the page')


def run(options: argparse.Namespace) -> int:
    """Write the page; 1 where a claim does not hold for the paper's own model."""
    # Imported before the work, so that a missing matplotlib is reported at once.
    from octo_arm_model.reproduce.page import as_html, summary

    check_out(options, 'outdir', folder=True)
    html = options.outdir / 'renda2012.html'
    with Bar('pictures') as bar:
        page = as_html(CLAIMS, bar)
    with writing(html) as place:
        place.write_text(page, encoding='utf-8')
    print(html, summary(CLAIMS), sep='\n')
    failed = [claim for claim in CLAIMS if claim.fails]
    for claim in failed:
        print(f'octo-arm: does not hold: {claim.says} ({claim.where})', file=sys.stderr)
    return 1 if failed else 0
