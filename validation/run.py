"""The models against three-dimensional elasticity, as the paper did in its section 5.1.

    python validation/run.py                   everything, twenty minutes or more
    python validation/run.py --coarse          two coarse meshes, two loads an arm: a minute or two
    python validation/run.py --out DIR         results.json and figures there, not beside this file
    python validation/run.py --case prototype  only one arm; nothing is written but with --out
    python validation/run.py --json            results on stdout as JSON instead of tables

Exit status: 0 done, 1 a check failed or a load was not reached.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from octo_arm_model import OctoArmError, __version__
from octo_arm_model.terminal import StatusLine

try:
    from cases import CASES, coarse
    from compare import run_case
    from verify import checks
except ModuleNotFoundError as error:
    sys.exit(
        f"run.py: error: needs {error.name}; install it with: pip install '.[figures,validation]'"
    )

HERE = Path(__file__).parent


class Progress(StatusLine):
    """One line on stderr: the part, its load and residual, and the time since the start."""

    def __init__(self) -> None:
        """Start the clock."""
        super().__init__(sys.stderr)
        self.part = ''
        self._start = time.monotonic()

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._start

    def __call__(self, line: str) -> None:
        """Show ``line``, on a terminal over the last one."""
        self.show(lambda: f'{self.seconds:6.0f} s  {self.part} {line}'[:98], always=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute, print and write; returns the exit status."""
    options = _parser().parse_args(arguments)
    progress = Progress()
    progress('checks of the elements')
    verified = checks()
    picked = [case for case in CASES if options.case in (None, case.name)]
    cases = {}
    try:
        for number, case in enumerate(picked, start=1):
            progress.part = f'[{number}/{len(picked)}]'
            cases[case.name] = run_case(coarse(case) if options.coarse else case, progress)
    except OctoArmError as error:
        progress.leave()
        print(f'run.py: error: {error}', file=sys.stderr)
        return 1
    progress.leave()
    results = {
        'made_by': 'python validation/run.py' + (' --coarse' if options.coarse else ''),
        'minutes': round(progress.seconds / 60.0, 1),
        'versions': {
            'octo_arm_model': __version__,
            'python': platform.python_version(),
            **{name: version(name) for name in ('numpy', 'scipy', 'scikit-fem')},
        },
        'checks': {
            check.what: {
                'found': float(f'{check.found:.8g}'),
                'expected': float(f'{check.expected:.8g}'),
                'error': float(f'{check.error:.1e}'),
                'tolerance': check.tolerance,
                'passed': check.passed,
            }
            for check in verified
        },
        'cases': cases,
    }
    print(json.dumps(results) if options.json else tables(results))
    folder = options.out or (None if options.coarse or options.case else HERE)
    if folder:
        _write(folder, results)
    return 0 if all(check.passed for check in verified) else 1


def tables(results: dict[str, Any]) -> str:
    """What a person reads first."""
    lines = ['checks of the elements' + ' ' * 22 + 'found      expected     error']
    for what, check in results['checks'].items():
        mark = '' if check['passed'] else '  FAILED'
        lines.append(
            f'  {what:38}{check["found"]:13.6g}{check["expected"]:13.6g}'
            f'{check["error"]:10.0e}{mark}'
        )
    for name, case in results['cases'].items():
        lines += ['', f'{name} ({case["arm"]}): distance of the tips, % of the length']
        loads = [' '.join(f'{t:.3g}' for t in load) for load in case['tensions_N']]
        lines.append(f'  {"tension [N]":30}' + ''.join(f'{load:>16}' for load in loads))
        rows = dict(case['tip_error_percent'])
        rows['uncertain by the mesh'] = case['mesh_error_percent']
        lines += [f'  {row:30}' + ''.join(f'{x:16.2f}' for x in rows[row]) for row in rows]
        lines.append('  what moves the tip of the elements, and what is then left to exact')
        for variant, found in case['variants'].items():
            at = {tuple(load): i for i, load in enumerate(found['loads'])}
            cells = [at.get(tuple(load)) for load in case['tensions_N']]
            moved, left = found['tip_change_percent'], found['tip_error_percent']['exact']
            lines.append(
                f'  {variant:30}'
                + ''.join(
                    ' ' * 16 if i is None else f'{moved[i]:9.2f} / {left[i]:.2f}' for i in cells
                )
            )
    lines += ['', f'made by {results["made_by"]} in {results["minutes"]} minutes']
    return '\n'.join(lines)


def _write(folder: Path, results: dict[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1)
    (folder / 'results.json').write_text(text + '\n', encoding='utf-8')
    print(folder / 'results.json', file=sys.stderr)
    try:
        from plots import draw
    except ModuleNotFoundError as error:
        hint = f"no figures: they need {error.name}; install it with: pip install '.[figures]'"
        print(hint, file=sys.stderr)
        return
    for path in draw(results, folder):
        print(path, file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    about, examples = (__doc__ or '').split('\n\n', 1)
    parser = argparse.ArgumentParser(
        description=about, epilog=examples, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--coarse', action='store_true', help='coarse meshes and few loads')
    parser.add_argument('--case', choices=[case.name for case in CASES], help='only this arm')
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder to write to')
    parser.add_argument('--json', action='store_true', help='JSON on stdout')
    return parser


if __name__ == '__main__':
    sys.exit(main())
