"""The models by their names."""

from __future__ import annotations

import functools
from collections.abc import Callable

from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.models.papers_model import PapersModel
from octo_arm_model.core.models.renda2012 import Renda2012
from octo_arm_model.core.models.sliding_closed_form import SlidingClosedForm
from octo_arm_model.core.models.statics import Setup, Statics


def _closed_form(setup: Setup) -> Statics:
    if setup.arm.friction:
        return SlidingClosedForm(setup)
    return PapersModel(ClosedForm, setup)


STATICS: dict[str, Callable[[Setup], Statics]] = {
    'renda2012': functools.partial(PapersModel, Renda2012),
    'closed_form': _closed_form,
    'exact': Exact,
}
MODELS = tuple(STATICS)
DEFAULT_MODEL = 'renda2012'
