"""All claims of the paper's text that are about its model, in its order."""

from __future__ import annotations

from collections.abc import Callable

from octo_arm_model.reproduce.claims import model_claims, results_claims
from octo_arm_model.reproduce.claims.claim import Claim

CLAIMS: tuple[Callable[[], Claim], ...] = (
    results_claims.one_cable,
    model_claims.in_space,
    model_claims.weight,
    model_claims.jumps,
    model_claims.finite_elements,
    model_claims.measured,
    model_claims.errors_grow,
    results_claims.plane_law,
    results_claims.captions,
    results_claims.any_anchorage,
    results_claims.more_tension,
    results_claims.fetching_in_plane,
    results_claims.opposite,
    results_claims.nearer_in_space,
    model_claims.antagonists,
    model_claims.fast_enough,
)
