"""The models by their names."""

from __future__ import annotations

import functools
from collections.abc import Callable

from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.models.papers_model import PapersModel
from octo_arm_model.core.models.renda2012 import Renda2012
from octo_arm_model.core.models.statics import Setup, Statics

STATICS: dict[str, Callable[[Setup], Statics]] = {
    'renda2012': functools.partial(PapersModel, Renda2012),
    'closed_form': functools.partial(PapersModel, ClosedForm),
    'exact': Exact,
}
MODELS = tuple(STATICS)
DEFAULT_MODEL = 'renda2012'
