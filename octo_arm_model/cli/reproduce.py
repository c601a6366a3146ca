"""``octo-arm reproduce``: recompute the paper's figures, tables and claims."""

import argparse
import sys

from octo_arm_model.cli.files import Bar, check_out, writing
from octo_arm_model.reproduce.claims import CLAIMS

SUMMARY = "recompute the paper's figures, tables and claims, on one page"
DESCRIPTION = """\
Recompute the paper's figures and tables with all three models, check the claims of its text, and
write the results to one page, OUTDIR/renda2012.html, which needs no other file and no network. A
browser prints it on A4. The command takes some ten seconds and needs matplotlib.
"""
EPILOG = """\
example:
  octo-arm reproduce reproduced

exit status: 0 all claims hold for the paper's own model, 1 one does not, 2 the input is wrong
"""


OPTIONS = 'outdir OUTDIR path: folder for the page'


def run(options: argparse.Namespace) -> int:
    """Write the page; return 1 if a claim does not hold for the paper's own model."""
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
