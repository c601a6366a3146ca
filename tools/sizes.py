#!/usr/bin/env python3
"""Check that no folder of the package has more lines than it may: part of `make lint`.

And that no line is kept from the formatter. Raising a bound is a decision, which the commit
explains; lowering one is progress.

    python3 tools/sizes.py
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_KEPT = '# fmt' + ':'
# Lines of Python, docstrings and comments included.
MOST = {
    'octo_arm_model': 44_840,
    'octo_arm_model/analysis': 1_600,
    'octo_arm_model/apps': 460,
    'octo_arm_model/arm': 2_490,
    'octo_arm_model/bags': 2_720,
    'octo_arm_model/cli': 2_960,
    'octo_arm_model/config': 1_740,
    'octo_arm_model/estimation': 3_730,
    'octo_arm_model/experiment': 6_000,
    'octo_arm_model/reproduce': 1_050,
    'octo_arm_model/rod': 11_210,
    'octo_arm_model/ros': 4_800,
    'octo_arm_model/simulation': 2_210,
    'octo_arm_model/viewer': 2_150,
    'octo_arm_model/wire': 1_410,
    'test': 24_180,
}


def count_lines(folder: Path) -> int:
    """Lines of all Python files below a ``folder``."""
    return sum(len(file.read_text(encoding='utf-8').splitlines()) for file in folder.rglob('*.py'))


def main() -> int:
    """Print every folder that is too large or has no bound, and return whether there is one."""
    complaints = []
    for name, most in MOST.items():
        found = count_lines(ROOT / name)
        if found > most:
            complaints.append(f'{name} has {found} lines of Python, at most {most} are allowed')
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
