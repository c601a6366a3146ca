"""First derivatives of the shape, and the covariance of the tip that follows from them.

At fixed twists a quantity p changes the residual by d res/dp, which a change of the twists
balances: J dz = - d res/dp. It changes poses at nodes and stations, in base_frame, by

    rotation phi = int R d kappa,    displacement d r = int phi x r' + R d v

where int is the integral from the base. Values at stations follow from those at the nodes by
integration and interpolation.
"""

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.special import gammaincinv

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.validation import check_class, check_fields, not_negative
from octo_arm_model.rod.equilibrium import Equilibrium, Problem
from octo_arm_model.rod.factors import LazyFactors, Linear
from octo_arm_model.rod.loads import along, in_sections, pose_rates
from octo_arm_model.rod.rod import Rod
from octo_arm_model.rod.rotations import skew
from octo_arm_model.rod.tables import REST_T, SHEAR, TORSION
from octo_arm_model.rod.tendons import PathChange, outward_paths

# Derivatives of the tip's position and rotation vector by several quantities, (6, n) each; None
# if the model has no such derivative.
TipChanges: TypeAlias = Sequence[FloatArray | None]
# The quantities by their names in messages.
_QUANTITIES = {
    'tension': 'tension',
    'youngs_modulus': "Young's modulus",
    'poisson_ratio': "Poisson's ratio",
    'offset': "the tendons' offsets",
}

_UNITS = {
    'tension': 'N',
    'youngs_modulus': '-',
    'poisson_ratio': '-',
    'offset': 'm',
    'model_position': 'm',
    'model_rotation': 'rad',
    'displacement': 'm',
}


@dataclass(frozen=True)
class Change:
    """The change of the shape per unit of one or several quantities, along the last axis.

    Attributes:
        pose: displacement [m] and rotation vector [rad] of each cross section, in base_frame,
            (stations, 6, quantities).
        strain: change of tau, xi, k [1/m] and q [-], (stations, 4, quantities).
        tendon_length: change of the length of every tendon [m], (tendons, quantities).
        tendon_tension: change of the mean tension of every tendon over its unloaded length [N],
            (tendons, quantities); None without friction, where it is the change at the base.
        twist: change of the twists at the nodes of the solver, (nodes, strains, quantities); None
            for the paper's models, and for tendons that are driven by length.
    """

    pose: FloatArray
    strain: FloatArray
    tendon_length: FloatArray
    tendon_tension: FloatArray | None = None
    twist: FloatArray | None = None

    @property
    def tip(self) -> FloatArray:
        """Displacement [m] and rotation [rad] of the tip, (6, quantities)."""
        return self.pose[-1]


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of independent quantities that the shape depends on.

    Attributes:
        tension: every tension [N].
        youngs_modulus: Young's modulus, relative [-].
        poisson_ratio: Poisson's ratio [-].
        offset: every tendon's distance from the midline [m].
        model_position: each coordinate of the tip, by the error of the model [m].
        model_rotation: each component of the tip's rotation vector, by this error [rad].
        displacement: every displacement of a tendon that is driven by length [m].

    Raises:
        ArmDefinitionError: if a value is not finite, or negative.
    """

    tension: float = 0.0
    youngs_modulus: float = 0.0
    poisson_ratio: float = 0.0
    offset: float = 0.0
    model_position: float = 0.0
    model_rotation: float = 0.0
    displacement: float = 0.0

    def __post_init__(self) -> None:
        """Check that every standard deviation is finite and not negative."""
        checks = {one: (not_negative, 'standard deviation', unit) for one, unit in _UNITS.items()}
        check_fields(self, 'uncertainty.', checks)

    @functools.cached_property
    def is_any(self) -> bool:
        """Whether anything is uncertain."""
        return self != Uncertainty()

    @functools.cached_property
    def quantities(self) -> tuple[str, ...]:
        """The names among tension, youngs_modulus, poisson_ratio and offset that are uncertain."""
        return tuple(name for name in _QUANTITIES if getattr(self, name))

    @functools.cached_property
    def of_model(self) -> FloatArray:
        """The covariance (6, 6) of the tip by the error of the model."""
        return np.diag(np.repeat([self.model_position**2, self.model_rotation**2], 3))

    def tip_covariance(self, changes: TipChanges) -> FloatArray:
        """Return the covariance (6, 6) of the tip's position [m] and rotation vector [rad].

        It is in base_frame. ``changes`` are the derivatives by `quantities`. The module
        `rod.displacements` adds the part of displacements.

        Raises:
            ConfigError: if there is no derivative by something that is uncertain.
        """
        covariance = self.of_model.copy()
        for name, change in zip(self.quantities, changes, strict=True):
            if change is None:
                quantity = _QUANTITIES[name]
                raise ConfigError(f'the model has no derivative by {quantity}: choose exact')
            covariance += getattr(self, name) ** 2 * change @ change.T
        return covariance


@dataclass(frozen=True)
class Sensitivity:
    """The first derivatives of one solution.

    The paper's models have those by tension and by E only; the others are None. Those by nu,
    offset and sheath are computed when they are first read.

    Attributes:
        by_tension: change per newton of each tendon's tension.
        by_tip_wrench: change per newton of force and newton metre of moment on the tip, in
            base_frame.
        by_youngs_modulus: change per relative change of E (1 is twice the stiffness), one column.
        by_poisson_ratio: change per unit of nu, one column.
        by_offset: change per metre of each tendon's distance from the midline.
        by_sheath_stiffness: change per pascal of each tendon's sheath, zero for a rigid one; None
            if all are rigid.
        by_friction: change per unit of each tendon's mu; None without friction.
        find: computes the derivatives by 'poisson_ratio', 'offset' or 'sheath_stiffness'.
    """

    by_tension: Change
    by_youngs_modulus: Change
    by_tip_wrench: Change | None = None
    by_friction: Change | None = None
    find: Callable[[str], Change | None] = lambda _: None

    @functools.cached_property
    def by_poisson_ratio(self) -> Change | None:
        """Change per unit of nu, one column; None if the model has none."""
        return self.find('poisson_ratio')

    @functools.cached_property
    def by_offset(self) -> Change | None:
        """Change per metre of each tendon's distance from the midline; None if there is none."""
        return self.find('offset')

    @functools.cached_property
    def by_sheath_stiffness(self) -> Change | None:
        """Change per pascal of each tendon's sheath; None if all sheaths are rigid."""
        return self.find('sheath_stiffness')

    @property
    def compliance(self) -> FloatArray:
        """Displacement [m] and rotation [rad] of the tip per [N] and [N m] on it, (6, 6).

        Raises:
            ConfigError: if the model has no loads.
        """
        if self.by_tip_wrench is None:
            raise ConfigError('the model has no loads, so no compliance: choose exact')
        return self.by_tip_wrench.tip

    def tip_covariance(self, uncertainty: Uncertainty) -> FloatArray:
        """Return the covariance (6, 6) of the tip's position [m] and rotation vector [rad].

        Raises:
            ConfigError: if the model has no derivative by something that is uncertain.
        """
        check_class('uncertainty', uncertainty, Uncertainty)
        changes: list[Change | None] = [
            getattr(self, f'by_{name}') for name in uncertainty.quantities
        ]
        return uncertainty.tip_covariance(
            [None if change is None else change.tip for change in changes]
        )


@functools.lru_cache(maxsize=1024)
def chi_square_limit(probability: float, size: int) -> float:
    """Return the quantile of the chi-square distribution of ``size`` degrees of freedom [-]."""
    # scipy.stats.chi2.ppf does the same, but its import takes a quarter of a second.
    return float(2.0 * gammaincinv(0.5 * size, probability))


# Of an equilibrium -------------------------------------------------------------------------------

_MATERIAL, _PATHS = ('youngs_modulus', 'poisson_ratio'), ('offset', 'sheath_stiffness')
_Columns: TypeAlias = Mapping[str, slice]  # of quantities, by their names in `Sensitivity`


def _columns(**counts: int) -> _Columns:
    """Return the columns of each quantity, given their counts; those without are left out."""
    ends = itertools.accumulate(counts.values())
    return {
        name: slice(end - count, end) for (name, count), end in zip(counts.items(), ends) if count
    }


class Linearisation:
    """The equations linearised about an equilibrium, with changes of the residual.

    Attributes:
        state: the equilibrium.
        factors: factors of the Jacobian.
        tendons: the tendons at the nodes.
        tension: derivatives of tensions with friction; None if tensions do not change.
        rates: derivatives of local tensions by those at the base at fixed twists, (N, J).
        rotation: rotation matrices of the nodes, as in `Work`.
        slope: r' of the nodes, as in `Work`.
    """

    def __init__(
        self, arm: Arm, problem: Problem, outwards: FloatArray, equilibrium: Equilibrium
    ) -> None:
        """Linearise about an ``equilibrium`` of ``arm`` on the nodes of ``problem``.

        ``outwards`` (4, N, J) are the `outward_paths` of the tendons there.
        """
        state, factors = equilibrium.state, equilibrium.factors
        problem.others.require_tangents()
        self.state, self.tension = state, problem.tension_derivatives(state)
        # The test of its stability may have linearised this state already.
        if not (isinstance(factors, LazyFactors) and factors.z is state.z):
            factors = problem.linearise(state)
        self.factors: Linear = factors
        problem.load_work(state)
        if self.tension is not None:
            self.tension.require(arm.tendon_names, state.condition.tensions)
        self.rates, self.tendons = problem.tension_rates(state), problem.tendons(state)
        work, self._arm, self._problem, self._outwards = problem.work, arm, problem, outwards
        self.rotation, self.slope = work.rotation.copy(), work.slope.copy()
        self._gradient = work.gradient.copy()

    def imbalance(self, columns: _Columns, total: int) -> FloatArray:
        """Return the change of the residual at fixed local tensions and loads, (n, m, total)."""
        change = np.zeros((*self.state.z.shape, total))
        for name, where in columns.items():
            if name in _MATERIAL:
                change[..., where] = getattr(self, f'by_{name}')[..., np.newaxis]
            elif name in _PATHS:
                change[..., where] = getattr(self, f'by_{name}').gradient.swapaxes(1, 2)
        return change

    @functools.cached_property
    def by_offset(self) -> PathChange:
        """Change per metre of each tendon's distance from the midline."""
        return self.tendons.by_path(self._outwards)

    @property
    def by_sheath_stiffness(self) -> PathChange:
        """Change per pascal of each sheath."""
        return self.tendons.by_sheath_stiffness

    @property
    def by_youngs_modulus(self) -> FloatArray:
        """Change of the residual per relative change of E, (n, m): the material's gradient."""
        pull = self.tendons.tension[..., np.newaxis] * self.tendons.gradient
        return np.asarray(self._gradient - pull.sum(axis=1))

    @property
    def by_poisson_ratio(self) -> FloatArray:
        """Change of the residual per unit of nu, which changes G alone, (n, m)."""
        arm, body, s = self._arm, self._problem.tables.body, self._problem.elements.s
        tendons, z, width = self.tendons, self.state.z, self.tendons.width[:, 0]
        by_ratio = -1.0 / (1.0 + arm.material.poisson_ratio_at(s))
        # The scaled torsion is w (kappa_t - kappa_t at rest), where w is 1 except for rubber.
        twist, gradient = z[:, 0] - body[:, REST_T], np.zeros_like(z)
        if 'torsion' not in arm.stiffness.profiles:
            torque = by_ratio * body[:, TORSION] * width * twist
            gradient[:, 0] = torque * width
            gradient[:, 3] = torque * tendons.widening[:, 0] * twist
        gradient[:, 4:] = (by_ratio * body[:, SHEAR])[:, np.newaxis] * z[:, 4:]
        return gradient


class Derivatives:
    """The first derivatives of equilibria of a rod on one level of nodes, at given stations."""

    def __init__(self, rod: Rod, level: int, s: FloatArray) -> None:
        """Prepare the stations at arc coordinates ``s`` (S,) [m] of ``rod``."""
        self._arm, self._problem = rod.arm, rod.problem(level)
        elements = self._problem.elements
        self._to_stations, self._at_stations = elements.integration(s), elements.interpolation(s)
        self._outwards = outward_paths(rod.arm, self._problem.tables, elements.s)
        tendons = self._problem.rest_lengths.size
        self._counts = dict.fromkeys(('tension', *_PATHS), tendons) | dict.fromkeys(_MATERIAL, 1)
        self._last: Linearisation | None = None

    def sensitivity(self, equilibrium: Equilibrium) -> Sensitivity:
        """Return the derivatives of an ``equilibrium`` by all quantities of `Sensitivity`.

        Raises:
            LoadError: if a load states no tangent stiffness.
            ConvergenceError: if the Jacobian is singular.
        """
        tendons, has_friction = self._counts['tension'], self._problem.friction is not None
        columns = _columns(
            tension=tendons, youngs_modulus=1, tip_wrench=6, friction=tendons * has_friction
        )
        wrenches = np.tile(np.eye(6), (self._problem.elements.s.size, 1, 1))
        change = self._change(equilibrium, columns, wrenches)
        parts: dict[str, Any] = {
            f'by_{name}': part_of(change, where) for name, where in columns.items()
        }
        return Sensitivity(**parts, find=functools.partial(self._by, equilibrium))

    def _by(self, equilibrium: Equilibrium, name: str) -> Change | None:
        """Return the change by nu or one of `_PATHS`; None for sheaths that are all rigid."""
        if name == 'sheath_stiffness' and not self._problem.tables.compliance.any():
            return None
        return self._change(equilibrium, _columns(**{name: self._counts[name]}))

    def by_loads(self, equilibrium: Equilibrium, loads: Sequence[Loads]) -> Change:
        """Return the change of an ``equilibrium`` per unit of each of the dead ``loads``.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
            LoadError: if a load states no tangent stiffness.
            ConvergenceError: if the Jacobian is singular.
        """
        problem = self._problem
        wrenches = np.empty((problem.elements.s.size, 6, len(loads)))
        for number, load in enumerate(loads):
            dead = problem.loads.tabulate(self._arm, problem.elements, load)
            wrenches[..., number] = np.concatenate(dead, axis=1) + load.tip_wrench
        return self._change(equilibrium, _columns(tip_wrench=len(loads)), wrenches)

    def tip_covariance(self, equilibrium: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """Return the covariance (6, 6) of the tip in an ``equilibrium``.

        Raises:
            LoadError: if a load states no tangent stiffness.
            ConvergenceError: if the Jacobian is singular.
        """
        columns = _columns(**{name: self._counts[name] for name in uncertainty.quantities})
        if not columns:
            return uncertainty.of_model
        linear, z, _ = self._twists(equilibrium, columns)
        tip = along(self._to_stations[-1:], self._pose_rates(linear, z))[0]
        return uncertainty.tip_covariance([tip[:, where] for where in columns.values()])

    def linearisation(self, equilibrium: Equilibrium) -> Linearisation:
        """Return the equations linearised about ``equilibrium``; the last ones are cached."""
        if self._last is None or self._last.state is not equilibrium.state:
            self._last = Linearisation(self._arm, self._problem, self._outwards, equilibrium)
        return self._last

    def _twists(
        self, equilibrium: Equilibrium, columns: _Columns, wrenches: FloatArray | None = None
    ) -> tuple[Linearisation, FloatArray, FloatArray]:
        """Return the linearisation, and changes of twists (N, m, n) and local tensions (N, J, n).

        ``columns`` are the n changes; ``wrenches`` (N, 6, loads) those of loads beyond the nodes.
        """
        linear = self.linearisation(equilibrium)
        total = max(where.stop for where in columns.values())
        by_local = linear.tendons.stretch_by_twist.swapaxes(1, 2)
        imbalance = linear.imbalance(columns, total)
        local = self._local_changes(linear, columns, total)
        if linear.tension is not None:
            imbalance += by_local @ local
        elif 'tension' in columns:
            imbalance[..., columns['tension']] += by_local
        if wrenches is not None:
            force, levers = wrenches[:, :3], skew(linear.slope) @ wrenches[:, :3]
            moment = wrenches[:, 3:] + along(self._problem.elements.to_tip, levers)
            rows = in_sections(linear.rotation, force, moment, linear.state.z.shape[1])
            imbalance[..., columns['tip_wrench']] -= rows
        z = linear.factors.solve(-imbalance.reshape(-1, total)).reshape(imbalance.shape)
        if linear.tension is not None:
            local += linear.tension.by_twists(z)
        return linear, z, local

    def _change(
        self, equilibrium: Equilibrium, columns: _Columns, wrenches: FloatArray | None = None
    ) -> Change:
        """Return the change of the shape by all ``columns``, with the arguments of `_twists`."""
        linear, z, local = self._twists(equilibrium, columns, wrenches)
        weights, tendons = self._problem.elements.weights, linear.tendons
        by_z = weights[:, np.newaxis, np.newaxis] * tendons.stretch_by_twist
        length = np.tensordot(by_z, z, axes=([0, 2], [0, 1]))
        if tendons.has_sheaths:
            length += np.einsum('i,ij,ijc->jc', weights, tendons.stretch_by_tension, local)
        tendon = np.arange(len(length))
        for name in set(_PATHS).intersection(columns):
            stretch = getattr(linear, f'by_{name}').stretch
            length[tendon, columns[name].start + tendon] += weights @ stretch
        mean = None
        if self._problem.friction is not None:
            mean = self._problem.mean_along_tendons(local)
        pose = along(self._to_stations, self._pose_rates(linear, z))
        strain = along(self._at_stations, strain_changes(linear.state.z, z))
        return Change(pose, strain, length, mean, z)

    def _pose_rates(self, linear: Linearisation, z: FloatArray) -> FloatArray:
        """Return the `pose_rates` of the nodes by changes ``z`` (N, m, columns) of the twists."""
        return pose_rates(self._problem.elements.from_base, linear.rotation, linear.slope, z)

    def _local_changes(self, linear: Linearisation, columns: _Columns, total: int) -> FloatArray:
        """Return the changes of the local tensions at fixed twists, (N, J, total)."""
        change, tension = np.zeros((*linear.rates.shape, total)), linear.tension
        tendon = np.arange(change.shape[1])
        for name, where in columns.items():
            if name == 'tension':
                change[:, tendon, where.start + tendon] = linear.rates
            elif tension is not None and name == 'friction':
                change[:, tendon, where.start + tendon] = tension.by_friction
            elif tension is not None and name in _PATHS:
                unit = getattr(linear, f'by_{name}').unit
                change[:, tendon, where.start + tendon] = tension.by_unit(unit)
        return change


def strain_changes(twist: FloatArray, z: FloatArray) -> FloatArray:
    """Return the changes of tau, xi, k, q (n, 4, columns) if ``twist`` (n, m) changes by ``z``."""
    # tau, xi, k are curvatures over the stretch.
    bends, stretch = twist[:, :3, np.newaxis], twist[:, 3:4, np.newaxis]
    strain = z[:, :4].copy()
    strain[:, :3] -= (bends / stretch) * z[:, 3:4]
    strain[:, :3] /= stretch
    return strain


def part_of(change: Change, where: slice) -> Change:
    """Return the quantities ``where`` of a ``change``."""
    mean, twist = change.tendon_tension, change.twist
    return Change(
        change.pose[..., where],
        change.strain[..., where],
        change.tendon_length[..., where],
        None if mean is None else mean[..., where],
        None if twist is None else twist[..., where],
    )
