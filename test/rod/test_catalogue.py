"""The catalogue of models is all that knows their names."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from octo_arm_model import Config, ConfigError, Loads, Solver
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.paper_equations import Strains
from octo_arm_model.rod.papers import Papers
from octo_arm_model.rod.solver import STATICS


class AllOfThem:
    """The arm turns about b by as much as all tensions are."""

    def __init__(self, arm: Arm, elements: Elements, s: FloatArray, form: Form) -> None:
        self._places = elements.s.size + s.size

    def solve(self, tensions: FloatArray) -> Strains:
        arms = len(tensions)
        twist = np.zeros((arms, self._places, 4), tensions.dtype)
        twist[..., 2] = tensions.sum(axis=-1)[:, np.newaxis]
        twist[..., 3] = 1.0
        return Strains(twist, np.zeros(arms), np.zeros(arms, np.int64))


def test_a_model_is_a_class_and_one_entry(table4: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STATICS, 'all_of_them', functools.partial(Papers, AllOfThem))
    solver = Solver(table4.arm, 'all_of_them', compiled=None)
    tensions = np.full((2, 3, 4), 0.5)
    found = solver.solve(tensions)
    np.testing.assert_allclose(found.k, 6.0, rtol=1e-12)
    sensitivity = solver.sensitivity(solver.solve(tensions[0]))
    np.testing.assert_allclose(sensitivity.by_tension.strain[:, 2], 1.0, rtol=1e-12)
    with pytest.raises(ConfigError, match='no loads but the tendons'):
        Solver(table4.arm, 'all_of_them', loads=Loads(tip_force=(0.0, 0.0, 1.0)))
    with pytest.raises(ConfigError, match=r'material\.shear goes with model exact'):
        Solver(table4.arm, 'all_of_them', material='linear', shear=True)
