"""A claim of the paper's text, and the numbers of each model on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from octo_arm_model.rod.solver import DEFAULT_MODEL, MODELS


@dataclass(frozen=True)
class Finding:
    """The numbers of a model on a claim.

    Attributes:
        value: the numbers, as text.
        holds: whether they agree with the claim; None where that cannot be judged.
    """

    value: str
    holds: bool | None = None


@dataclass(frozen=True)
class Claim:
    """A claim of the paper's text.

    Attributes:
        says: the paper's words.
        where: where in the paper they are.
        check: what was computed, and when the claim holds; or why it cannot be checked.
        findings: by model; empty where it cannot be checked.
        is_of_machine: whether the numbers depend on the machine, as times do.
    """

    says: str
    where: str
    check: str
    findings: Mapping[str, Finding] = field(default_factory=dict)
    is_of_machine: bool = False

    @property
    def fails(self) -> bool:
        """Whether the paper's own model contradicts it; false for what depends on the machine."""
        finding = self.findings.get(DEFAULT_MODEL)
        return finding is not None and finding.holds is False and not self.is_of_machine


def count(claims: Sequence[Claim], model: str) -> tuple[int, int]:
    """How many claims hold for ``model``, and how many could be judged."""
    verdicts = [claim.findings[model].holds for claim in claims if model in claim.findings]
    return verdicts.count(True), len(verdicts) - verdicts.count(None)


def of_models(judge: Callable[[str], Finding]) -> dict[str, Finding]:
    """Findings of all models, by model."""
    return {model: judge(model) for model in MODELS}


def claim(
    says: str, where: str, check: str
) -> Callable[[Callable[[str], Finding]], Callable[[], Claim]]:
    """Make a claim of a function that judges one model; it is called when the claim is made."""

    def of(judge: Callable[[str], Finding]) -> Callable[[], Claim]:
        return lambda: Claim(says, where, check, of_models(judge))

    return of


def below(value: float, digits: int) -> str:
    """``value`` to ``digits`` decimals, or that it is less than the last of them."""
    least = 10.0**-digits
    return f'{value:.{digits}f}' if value >= least / 2.0 else f'less than {least:.{digits}f}'
