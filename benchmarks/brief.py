"""The option of every benchmark to run but briefly, to see that it runs."""

from __future__ import annotations

import argparse
import sys

# Asked for before the options are parsed: the lengths of a run are constants of its module.
IS_BRIEF = '--brief' in sys.argv[1:]


def make_parser(description: str | None) -> argparse.ArgumentParser:
    """Parser of a benchmark's options."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        '--brief', action='store_true', help='only see that it runs; its numbers mean nothing then'
    )
    return parser
