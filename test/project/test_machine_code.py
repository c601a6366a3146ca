"""Whatever solves more than one shape does so in machine code where numba works."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from experiments import midline, one_tendon, path_sample, staircase_bag
from recordings import Sample

from octo_arm_model import Solver
from octo_arm_model.cli.main import main

pytest.importorskip('numba', reason='needs numba')


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, bool]]:
    """Of every solve its model and whether it runs in machine code."""
    seen = []
    solve = Solver.solve

    def recorded(self: Solver, *given: Any, **named: Any) -> Any:
        seen.append((self.model, self.is_compiled))
        return solve(self, *given, **named)

    monkeypatch.setattr(Solver, 'solve', recorded)
    return seen


@pytest.mark.parametrize('model', ['renda2012', 'exact'])
@pytest.mark.parametrize(
    'arguments',
    [
        ['inverse', 'renda2012_prototype', '--tip', '0.25', '0.05', '0.0'],
        ['workspace', 'renda2012_prototype', '--samples', '64', '--processes', '1'],
    ],
    ids=lambda arguments: arguments[0],
)
def test_commands_solve_in_machine_code(
    arguments: list[str],
    model: str,
    solved: list[tuple[str, bool]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)  # where workspace leaves its picture
    assert main([*arguments, '--model', model]) == 0
    assert set(solved) == {(model, True)}


def test_identify_does(tmp_path: Path, solved: list[tuple[str, bool]]) -> None:
    def see(tension: float, stamp_ns: int) -> Sample:
        return path_sample(midline('closed_form', one_tendon(tension), 31), stamp_ns)

    bag = staircase_bag(tmp_path / 'bag', (0.0, 1.0, 2.0), see)
    solved.clear()
    main(['identify', str(bag), '--model', 'closed_form', 'exact', '--fit', 'youngs_modulus'])
    assert set(solved) == {('closed_form', True), ('exact', True)}
