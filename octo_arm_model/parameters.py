"""Every parameter of the arm and its node, declared once.

The YAML loader reads this table, the node declares its ROS parameters from it and a test holds
the README to it, so a name, a unit or a default is written in one place only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from octo_arm_model.errors import ConfigError
from octo_arm_model.grid import DEFAULT_STATIONS
from octo_arm_model.solver import DEFAULT_MODEL


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    Attributes:
        name: dotted name, as in ROS.
        kind: type of a value, or of the elements where ``is_array``.
        description: what it is, with its unit in brackets.
        default: value where none is given; None means it must be given.
        is_array: whether it is a list.
    """

    name: str
    kind: type
    description: str
    default: Any = None
    is_array: bool = False

    @property
    def type_name(self) -> str:
        """Type in the words of ROS, e.g. ``double[]``."""
        word = {float: 'double', int: 'integer', str: 'string'}[self.kind]
        return word + '[]' if self.is_array else word

    def convert(self, value: object) -> Any:
        """Return ``value`` as this parameter's type; an integer will do for a double.

        Raises:
            ConfigError: if the type is another.
        """
        if self.is_array and isinstance(value, (list, tuple)):
            return tuple(self._convert_one(element, value) for element in value)
        return self._convert_one(value, value) if not self.is_array else self._refuse(value)

    def _convert_one(self, element: object, value: object) -> Any:
        if self.kind is float and isinstance(element, int) and not isinstance(element, bool):
            try:
                return float(element)
            except OverflowError:
                return self._refuse(value)
        if isinstance(element, self.kind) and not isinstance(element, bool):
            return element
        return self._refuse(value)

    def _refuse(self, value: object) -> Any:
        raise ConfigError(f'{self.name} is {value!r}, expected {self.type_name}')


PARAMETERS = (
    Parameter('model', str, 'model that turns tensions into strains', DEFAULT_MODEL),
    Parameter('stations', int, 'stations along the backbone, anchorages among them',
              DEFAULT_STATIONS),
    Parameter('base_frame', str, 'frame the backbone is expressed in', 'arm_base'),
    Parameter('base.position', float, 'position of the base in base_frame [m]', (0.0, 0.0, 0.0),
              is_array=True),
    Parameter('base.quaternion', float,
              'orientation of the base in base_frame, x y z w: x axis along the arm, y axis n, '
              'z axis b', (0.0, 0.0, 0.0, 1.0), is_array=True),
    Parameter('material.youngs_modulus', float, "Young's modulus E [Pa]"),
    Parameter('material.poisson_ratio', float, "Poisson's ratio nu [-]", 0.5),
    Parameter('body.length', float, 'length L of the arm [m]'),
    Parameter('body.radius_base', float, 'radius at the base [m]'),
    Parameter('body.radius_tip', float, 'radius at the tip [m]'),
    Parameter('sections.anchorage', float,
              'arc coordinate of each anchorage, from the tip to the base [m]', is_array=True),
    Parameter('sections.offset_base', float,
              "distance of each section's tendons from the midline at the base [m]",
              is_array=True),
    Parameter('sections.offset_anchorage', float,
              "distance of each section's tendons from the midline at its anchorage [m]",
              is_array=True),
    Parameter('tendon_names', str,
              'names of the tendons, section by section from the tip; empty for '
              'tendon_<section>_<tendon>', (), is_array=True),
)  # fmt: skip
