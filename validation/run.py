"""Compare the models with three-dimensional elasticity, as the paper's section 5.1 does.

    python validation/run.py                   all arms: twenty minutes or more
    python validation/run.py --coarse          two coarse meshes, two loads per arm: two minutes
    python validation/run.py --out DIR         write results.json and figures to DIR
    python validation/run.py --case prototype  one arm only; writes nothing without --out
    python validation/run.py --json            print the results as JSON instead of tables

Exit status: 0 without errors, 1 if a check failed or a load has no solution.
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
    from cases import CASES, coarse_case
    from compare import run_case
    from verify import checks
except ModuleNotFoundError as error:
    sys.exit(
        f"run.py: error: needs {error.name}; install it with: pip install '.[figures,validation]'"
    )

HERE = Path(__file__).parent


class Progress(StatusLine):
    """A line on stderr: case, load and residual, and the time since the start."""

    def __init__(self) -> None:
        """Start the clock."""
        super().__init__(sys.stderr)
        self.part = ''
        self._start = time.monotonic()

    @property
    def seconds(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._start

    def __call__(self, line: str) -> None:
        """Show ``line``; on a terminal it replaces the last one."""
        self.show(lambda: f'{self.seconds:6.0f} s  {self.part} {line}'[:98], always=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all cases, print and write the results; return the exit status."""
    options = _parser().parse_args(arguments)
    progress = Progress()
    progress('checks of the elements')
    checked = checks()
    selected = [case for case in CASES if options.case in (None, case.name)]
    cases = {}
    try:
        for number, case in enumerate(selected, start=1):
            progress.part = f'[{number}/{len(selected)}]'
            cases[case.name] = run_case(coarse_case(case) if options.coarse else case, progress)
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
            for check in checked
        },
        'cases': cases,
    }
    print(json.dumps(results) if options.json else tables(results))
    folder = options.out or (None if options.coarse or options.case else HERE)
    if folder:
        _write(folder, results)
    return 0 if all(check.passed for check in checked) else 1


def tables(results: dict[str, Any]) -> str:
    """Return the results as text."""
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
        rows['error of the mesh'] = case['mesh_error_percent']
        lines += [f'  {row:30}' + ''.join(f'{x:16.2f}' for x in rows[row]) for row in rows]
        lines.append("  variants: change of the elements' tip / distance of exact from it")
        for variant, result in case['variants'].items():
            index_of = {tuple(load): i for i, load in enumerate(result['loads'])}
            cells = [index_of.get(tuple(load)) for load in case['tensions_N']]
            changes, left = result['tip_change_percent'], result['tip_error_percent']['exact']
            lines.append(
                f'  {variant:30}'
                + ''.join(
                    ' ' * 16 if i is None else f'{changes[i]:9.2f} / {left[i]:.2f}' for i in cells
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
    parser.add_argument('--coarse', action='store_true', help='use coarse meshes and few loads')
    parser.add_argument('--case', choices=[case.name for case in CASES], help='run only this arm')
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder of the results')
    parser.add_argument('--json', action='store_true', help='print JSON')
    return parser


if __name__ == '__main__':
    sys.exit(main())
