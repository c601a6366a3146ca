"""Hypothesis strategies for valid arms and tensions within their limits."""

import numpy as np
from hypothesis import strategies as st

from octo_arm_model import Arm, Body, Material, Section

# Tensions of three tendons [N], sequences of them, and times [s].
tensions = st.lists(st.floats(0.0, 50.0), min_size=3, max_size=3).map(np.array)
commands = st.lists(tensions, min_size=1, max_size=8)
times = st.floats(1e-3, 100.0)

MODEL_NAMES = ('renda2012', 'closed_form')
# Largest tensions of the paper on each arm [N], by section: Tables 1, 3 and 5. The paper does not
# state those of Figure 8, for which the tip is compressed like that of Figure 15.
PAPER_SIZE = {0.3: (0.3,), 0.27: (3.95,), 0.31: (1.75, 4.0, 13.0), 0.45: (0.5, 4.0, 13.0)}


def fractions(low: float = 0.0, high: float = 1.0) -> st.SearchStrategy[float]:
    """Draw numbers from ``low`` to ``high`` that are not subnormal."""
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def arms(draw: st.DrawFn, max_sections: int = 4) -> Arm:
    """Draw arms of 0.1 to 1 m, slender like the paper's, with tendons anywhere in the body."""
    length = draw(fractions(0.1, 1.0))
    radius_base = length * draw(fractions(0.03, 0.08))
    body = Body(length, radius_base, radius_base * draw(fractions(0.12, 1.0)))
    count = draw(st.integers(1, max_sections))
    # Gaps between anchorages; the first one, beyond the last anchorage, may be 0.
    gaps = [draw(fractions(0.0, 0.5)) * draw(st.integers(0, 1))]
    gaps += [draw(fractions(0.2, 1.0)) for _ in range(count)]
    anchorages = length * (1.0 - np.cumsum(gaps)[:-1] / np.sum(gaps))
    sections = tuple(
        Section(
            float(anchorage),
            radius_base * draw(fractions(0.05, 0.9)),
            float(body.radius(anchorage)) * draw(fractions(0.05, 0.9)),
        )
        for anchorage in anchorages
    )
    young, ratio = draw(fractions(1e4, 1e6)), draw(fractions(0.0, 0.5))
    return Arm(Material(young, ratio), body, sections)


def scaled(arm: Arm, scale: float) -> Arm:
    """Return ``arm`` with all lengths times ``scale``."""
    body = arm.body
    sections = tuple(
        Section(*(scale * np.array([part.anchorage, part.offset_base, part.offset_anchorage])))
        for part in arm.sections
    )
    sizes = scale * np.array([body.length, body.radius_base, body.radius_tip])
    return Arm(arm.material, Body(*sizes), sections)


@st.composite
def tensions_for(draw: st.DrawFn, arm: Arm, load: float = 0.35) -> np.ndarray:
    """Draw tensions that compress each section by at most ``load`` at its anchorage.

    The paper has 36 % in section 1 of Figure 15 and 31 % in section 3.
    """
    rows = []
    for section in arm.sections:
        radius = float(arm.body.radius(section.anchorage))
        largest = load * arm.material.youngs_modulus * np.pi * radius**2
        pulls = np.array([draw(st.just(0.0) | fractions()) for _ in range(4)])
        rows.append(largest * pulls / max(1.0, pulls.sum()))
    return np.array(rows)


@st.composite
def loaded_arms(draw: st.DrawFn, max_sections: int = 4) -> tuple[Arm, np.ndarray]:
    """Draw an arm and tensions for it."""
    arm = draw(arms(max_sections))
    return arm, draw(tensions_for(arm))
