"""The parameter file of a fitted arm."""

from __future__ import annotations

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.experiment.fitting.identification import Identification
from octo_arm_model.experiment.fitting.uncertainty import Estimate


def as_config(fitted: Identification, source: str) -> str:
    """ROS parameter file of a fitted arm, with how well its material and model are known.

    The calibration of load cells is among the parameters, so that who reads the same recording by
    this file finds the misfit of the fit.

    Raises:
        ConfigError: if no node could load it.
    """
    values = dict(fitted.parameters)
    estimates = fitted.estimates
    young, ratio = estimates.get('youngs_modulus'), estimates.get('poisson_ratio')
    if young is not None and young.value is not None and young.stddev is not None:
        values['material.youngs_modulus_stddev'] = young.stddev / young.value
    if ratio is not None and ratio.stddev is not None:
        values['material.poisson_ratio_stddev'] = ratio.stddev
    if fitted.tip_stddev is not None:
        values['model_error_stddev'] = fitted.tip_stddev
    Config.from_parameters(values)  # It must load where it goes.
    lines = [f'# Fitted to {source} by octo-arm identify.']
    for name, estimate in estimates.items():
        lines.append(f'# {name}: {in_words(estimate)}')
    return '\n'.join(lines) + '\n' + parameters_as_yaml(values)


def in_words(estimate: Estimate) -> str:
    """An estimate in words."""
    if estimate.value is None:
        return 'not determined'
    text = f'{estimate.value:.6g} {estimate.unit}'
    if estimate.stddev is None or estimate.interval95 is None:
        return f'{text}, no interval'
    low, high = estimate.interval95
    return f'{text}, stddev {estimate.stddev:.2g}, 95 % interval {low:.6g} to {high:.6g}'
