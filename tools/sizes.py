#!/usr/bin/env python3
"""Check that no folder of the package has more lines than its bound: part of `make lint`.

Check also that no line is kept from the formatter. To raise a bound is a decision that the commit
explains; to lower one is progress.

    python3 tools/sizes.py
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_KEPT = '# fmt' + ':'
# Largest numbers of lines of Python, with docstrings and comments.
MOST = {
    'octo_arm_model': 43_170,
    'octo_arm_model/analysis': 1_520,
    'octo_arm_model/apps': 450,
    'octo_arm_model/arm': 2_420,
    'octo_arm_model/bags': 2_330,
    'octo_arm_model/cli': 2_880,
    'octo_arm_model/config': 1_660,
    'octo_arm_model/estimation': 3_350,
    'octo_arm_model/experiment': 6_040,
    'octo_arm_model/reproduce': 1_010,
    'octo_arm_model/rod': 11_160,
    'octo_arm_model/ros': 4_490,
    'octo_arm_model/simulation': 2_170,
    'octo_arm_model/viewer': 2_070,
    'octo_arm_model/wire': 1_350,
    'test': 24_340,
}


def count_lines(folder: Path) -> int:
    """Return the number of lines of all Python files below a ``folder``."""
    return sum(len(file.read_text(encoding='utf-8').splitlines()) for file in folder.rglob('*.py'))


def main() -> int:
    """Print all folders that are too large or have no bound; return 1 if there is one, else 0."""
    complaints = []
    for name, most in MOST.items():
        lines = count_lines(ROOT / name)
        if lines > most:
            complaints.append(f'{name} has {lines} lines of Python, at most {most} are allowed')
    for folder in sorted((ROOT / 'octo_arm_model').iterdir()):
        name = folder.relative_to(ROOT).as_posix()
        if folder.is_dir() and folder.name != '__pycache__' and name not in MOST:
            complaints.append(f'{name} has no bound of lines, expected one in tools/sizes.py')
    for file in sorted(ROOT.glob('[a-z]*/**/*.py')):
        if _KEPT in file.read_text(encoding='utf-8'):
            complaints.append(f'{file.relative_to(ROOT)} keeps lines from the formatter: {_KEPT}')
    print('\n'.join(complaints), file=sys.stderr, end='\n' * bool(complaints))
    return bool(complaints)


if __name__ == '__main__':
    sys.exit(main())
