"""The option --brief of the benchmarks: a run of seconds that shows only that the code works."""

from __future__ import annotations

import argparse
import sys

# Read before argparse runs, because modules compute their constants from it.
IS_BRIEF = '--brief' in sys.argv[1:]


def make_parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser with the option --brief."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        '--brief', action='store_true', help='check only that it runs; the numbers mean nothing'
    )
    return parser
