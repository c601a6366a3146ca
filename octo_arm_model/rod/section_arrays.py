"""Node functions of cross sections over whole arrays; `section_loops` has their equations."""

from typing import TypeAlias

import numpy as np

from octo_arm_model.arm.hints import FloatArray, Number
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.rod.section_formulas import (
    bent_by,
    density,
    offset_stiffness,
    residual_left,
    rest_bend,
    widening,
)
from octo_arm_model.rod.tables import (
    ALONG_B,
    ALONG_N,
    AXIAL,
    LEVER,
    REST_T,
    SHEAR,
    SQUARED_B,
    SQUARED_N,
    TORSION,
    Tables,
    Work,
    force_scale,
)

_MOST_STEPS = 30  # for the offset of a tendon in its sheath
ROUGH = 0.5  # cosine between a tendon's bends at the ends of an element for `Bends.is_rough`
_CONVERGED = 1e-14  # square of the last change of an offset, over the lever
_MOST_BALANCE = 200  # steps to the balance of a section
_ROUNDING = 1e-6  # residual below which steps are not shortened
_SHORTENED = 0.5  # factor of a step that is too long
_OVERSHOOT = 0.9  # part of the slope along a step that may be left with opposite sign at its end
# Indices that permute components for cross products.
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products along the last axis."""
    product: FloatArray = a[..., NEXT] * b[..., LAST] - a[..., LAST] * b[..., NEXT]
    return product


class PulledTendons:
    """The tendons under tension at n nodes, and their vectors u.

    Attributes:
        tension: their tensions [N], zero beyond the anchorage, (J, n).
        pulled: their indices among all tendons, (J,).
        strain: the six scaled strains, (6, n).
        unit: c = u / |u|, (3, J, n).
        inverse: 1 / |u|, (J, n).
    """

    def __init__(
        self,
        tables: Tables,
        strain: FloatArray,
        width: FloatArray,
        tensions: FloatArray,
        work: Work,
    ) -> None:
        """Compute u of tendons with ``tensions`` (n, J) [N] in sections of ``strain`` (6, n)."""
        tension = (tensions * tables.reach).T
        # Slack tendons are left out.
        self.pulled = np.flatnonzero(tension.any(axis=1))
        if not self.pulled.size:
            self.pulled = np.array([0])  # NumPy cannot infer shapes from arrays without tendons.
        self.tension = np.ascontiguousarray(tension[self.pulled])
        # u and its derivatives are linear in x, y, dx, dy and 1.
        self._path = np.ones((5, *self.tension.shape))
        self._path[:4] = tables.tendons.T[:, self.pulled]
        x, y, self.dx, self.dy, _ = self._path
        self.compliance = tables.compliance[self.pulled, np.newaxis]
        self.strain, self._width = strain, width
        self._strains = work.residual.shape[1]
        if self.compliance.any():
            offsets = self._offsets(x, y, tables.body[:, LEVER])
            work.offsets[:, self.pulled] = offsets.T
            self._path[:2] += offsets
        self.x, self.y = x, y
        u = self._along(x, y)
        self.inverse = 1.0 / np.sqrt((u * u).sum(axis=0))
        self.unit = u * self.inverse
        self._winding = self.dx * self.unit[1] + self.dy * self.unit[2]

    def _along(self, x: FloatArray, y: FloatArray) -> FloatArray:
        t, n, b, stretch, v_n, v_b = self.strain
        u = np.empty((3, *x.shape))
        u[0] = stretch + n * y - b * x
        u[1] = self._width * self.dx - t * y + v_n
        u[2] = self._width * self.dy + t * x + v_b
        return u

    def _offsets(self, x: FloatArray, y: FloatArray, lever: FloatArray) -> FloatArray:
        t, n, b, stretch = self.strain[:4]
        yielding = self.compliance * self.tension
        guess = np.where(yielding * (n * n + b * b) < 0.25 * stretch, yielding, 0.0)
        d, change = np.stack([guess * b, -guess * n]), np.full(x.shape, np.inf)
        for _ in range(_MOST_STEPS):
            u_t, u_n, u_b = self._along(x + d[0], y + d[1])
            inverse = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
            p_n, p_b = (t * u_b - b * u_t) * inverse, (n * u_t - t * u_n) * inverse
            r_n, r_b = d[0] + yielding * p_n, d[1] + yielding * p_b
            nn, nb, bb = offset_stiffness((t, n, b), (p_n, p_b), yielding * inverse)
            inverse = 1.0 / (nn * bb - nb * nb)
            step = np.stack([(bb * r_n - nb * r_b) * inverse, (nn * r_b - nb * r_n) * inverse])
            # The offset of a tendon no longer changes once it has converged.
            d = d - np.where(change * change > _CONVERGED, step, 0.0)
            step_size = np.abs(step).sum(axis=0) / lever
            change = np.where(change * change > _CONVERGED, step_size, change)
            if not (change * change > _CONVERGED).any():
                break
        return np.where(change * change <= _CONVERGED, d, np.nan)

    def by_strain(self, slope: FloatArray) -> FloatArray:
        """Return the gradient of |u| by the scaled strain, (m, J, n)."""
        u_t, u_n, u_b = self.unit
        gradient = np.empty((self._strains, *u_t.shape))
        gradient[0] = self.x * u_b - self.y * u_n
        gradient[1], gradient[2] = self.y * u_t, -self.x * u_t
        gradient[3] = u_t + slope * self._winding
        gradient[4:] = self.unit[1 : self._strains - 3]
        return gradient

    def derivatives(self, slope: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient (m, n) and Hessian (m, m, n) of the energy of tendons and sheaths.

        They are by the m scaled strains, which are four without shear.
        """
        gradient, strains = self.by_strain(slope), self._strains
        weight = self.tension * self.inverse
        path = self._path.copy()
        path[2:4] *= slope
        squares = np.einsum('kjn,ljn->kln', weight * path, path)
        hessian = (_SQUARES[strains] @ squares.reshape(25, -1)).reshape(strains, strains, -1)
        hessian -= np.einsum('ajn,cjn->acn', weight * gradient, gradient)
        hessian[3, 3] += bend * np.einsum('jn,jn->n', self.tension, self._winding)
        if self.compliance.any():
            hessian -= self._condensed(np.einsum('ack,kjn->cajn', _BY[:strains], path), gradient)
        return np.einsum('ajn,jn->an', gradient, self.tension), hessian

    def _condensed(self, by: FloatArray, g: FloatArray) -> FloatArray:
        """Return C D^-1 C^T of the offsets in sheaths, (m, m, n)."""
        t, n, b = self.strain[:3]
        u_t, u_n, u_b = self.unit
        p_n, p_b = t * u_b - b * u_t, n * u_t - t * u_n
        weight = self.tension * self.inverse
        mixed = np.stack(
            [
                weight * (t * by[2] - b * by[0] - p_n * g),
                weight * (n * by[0] - t * by[1] - p_b * g),
            ]
        )
        mixed[0, 0] += self.tension * u_b
        mixed[0, 2] -= self.tension * u_t
        mixed[1, 0] -= self.tension * u_n
        mixed[1, 1] += self.tension * u_t
        nn, nb, bb = offset_stiffness((t, n, b), (p_n, p_b), self.compliance * weight)
        factor = self.compliance / (nn * bb - nb * nb)
        solved = factor * np.stack([bb * mixed[0] - nb * mixed[1], nn * mixed[1] - nb * mixed[0]])
        return np.asarray(np.einsum('dajn,dcjn->acn', mixed, solved))


# From x, y, slope dx, slope dy and 1 to du/de by the six scaled strains, (6, 3, 5); and from the
# products of the former to the products of the latter, of four or all strains, (16 or 36, 25).
_BY = np.zeros((6, 3, 5))
_BY[[0, 2], [1, 0], [1, 0]] = -1.0
_BY[[0, 1, 3, 3, 3, 4, 5], [2, 0, 0, 1, 2, 1, 2], [0, 1, 4, 2, 3, 4, 4]] = 1.0
_SQUARES = {m: np.einsum('ack,bcl->abkl', _BY[:m], _BY[:m]).reshape(-1, 25) for m in (4, 6)}


def _scaled(z: FloatArray, width: FloatArray) -> FloatArray:
    """Return the six scaled strains, (6, n)."""
    strain = np.zeros((6, len(z)))
    strain[: z.shape[1]] = z.T
    strain[:3] *= width
    return strain


_Density: TypeAlias = tuple[Number, Number, Number, Number, Number]


def _from_rest(tables: Tables, strain: FloatArray, width: FloatArray) -> FloatArray:
    """Return the scaled strains (6, n) less those at rest."""
    rest = tables.body[:, REST_T:].T
    if not rest.any():
        return strain
    bend, _ = rest_bend(tables.law, strain[3])
    strain = strain.copy()
    strain[:3] -= np.stack([width, bend, bend]) * rest
    return strain


def _density_at(tables: Tables, strain: FloatArray) -> _Density:
    """Return the derivatives `density` at scaled strains (6, n)."""
    squares = tables.body[:, SQUARED_N : SQUARED_B + 1].T
    bend = (strain[1:3] * strain[1:3] * squares).sum(axis=0)
    return density(tables.law, strain[3], bend)


def _stress(tables: Tables, strain: FloatArray, parts: _Density) -> FloatArray:
    """Return the gradient (6, n) of the energy of the material by the scaled strain (6, n)."""
    body, (by_stretch, by_bend, *_) = tables.body.T, parts
    stress = strain.copy()
    stress[0] *= body[TORSION]
    stress[1:3] *= 2.0 * body[AXIAL] * by_bend * body[SQUARED_N : SQUARED_B + 1]
    stress[3] = body[AXIAL] * by_stretch
    stress[4:] *= body[SHEAR]
    return stress


def _stiffness(tables: Tables, strain: FloatArray, parts: _Density) -> FloatArray:
    """Return the Hessian (6, 6, n) of the energy of the material by the scaled strain (6, n)."""
    body, axial = tables.body.T, tables.body[:, AXIAL]
    n, b = strain[1] * body[SQUARED_N], strain[2] * body[SQUARED_B]
    _, by_bend, by_ss, by_sb, by_bb = parts
    once, both, second = 2.0 * axial * by_bend, 2.0 * axial * by_sb, 4.0 * axial * by_bb
    h = np.zeros((6, 6, n.size))
    h[0, 0] = body[TORSION]
    h[1, 1] = once * body[SQUARED_N] + second * n * n
    h[2, 2] = once * body[SQUARED_B] + second * b * b
    h[1, 2] = h[2, 1] = second * n * b
    h[1, 3] = h[3, 1] = both * n
    h[2, 3] = h[3, 2] = both * b
    h[3, 3] = axial * by_ss
    h[4, 4] = h[5, 5] = body[SHEAR]
    return h


def _add_rest(
    tables: Tables,
    strain: FloatArray,
    widening: tuple[FloatArray, FloatArray, FloatArray],
    g: FloatArray,
    h: FloatArray | None = None,
) -> None:
    """Add to the rows of the stretch the terms of the bend at rest, which changes with it.

    ``g`` (6, n) and ``h`` (6, 6, n) are gradient and Hessian of the energy of the material.
    """
    rest = tables.body[:, REST_T:].T
    if tables.law == LINEAR or not rest.any():
        return
    (_, slope, bend), (_, by_stretch) = widening, rest_bend(tables.law, strain[3])
    d = rest * np.stack([slope, by_stretch, by_stretch])
    torque = g[0].copy()
    g[3] -= (d * g[:3]).sum(axis=0)
    if h is not None:
        by = np.einsum('acn,cn->an', h[:3, :3], d)
        h[3, 3] += ((by - 2.0 * h[3, :3]) * d).sum(axis=0) - bend * rest[0] * torque
        h[3, :3] -= by
        h[:3, 3] -= by


def _unscale(
    tables: Tables,
    z: FloatArray,
    widening: tuple[FloatArray, FloatArray, FloatArray],
    g: FloatArray,
    h: FloatArray | None = None,
) -> None:
    """Transform gradient (m, n) and Hessian (m, m, n) from the scaled strain to the twist."""
    if tables.law == LINEAR:
        return
    (width, slope, bend), bends = widening, z.T[:3]
    along = (bends * g[:3]).sum(axis=0)
    if h is not None:
        by = slope * np.einsum('acn,cn->an', h[:3, :3], bends)
        h[3, 3] += slope * (bends * (2.0 * h[3, :3] + by)).sum(axis=0) + bend * along
        h[3, :3] = h[:3, 3] = width * (h[3, :3] + by) + slope * g[:3]
        h[:3, :3] *= width * width
    g[3] += slope * along
    g[:3] *= width


def gradients(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Compute the gradient of the energy of every cross section by the twist."""
    strains, (width, slope, bend) = z.shape[1], widening(tables.law, z[:, 3])
    strain = _scaled(z, width)
    elastic = _from_rest(tables, strain, width)
    g = _stress(tables, elastic, _density_at(tables, elastic))
    _add_rest(tables, strain, (width, slope, bend), g)
    tendons = PulledTendons(tables, strain, width, tensions, work)
    g[:strains] += np.einsum('ajn,jn->an', tendons.by_strain(slope), tendons.tension)
    _unscale(tables, z, (width, slope, bend), g)
    work.gradient[:] = g[:strains].T


def sections(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Compute the gradient and the Hessian of the energy of every cross section by the twist."""
    strains, (width, slope, bend) = z.shape[1], widening(tables.law, z[:, 3])
    strain = _scaled(z, width)
    elastic = _from_rest(tables, strain, width)
    parts = _density_at(tables, elastic)
    g, h = _stress(tables, elastic, parts), _stiffness(tables, elastic, parts)
    _add_rest(tables, strain, (width, slope, bend), g, h)
    tendons = PulledTendons(tables, strain, width, tensions, work)
    by_strain, second = tendons.derivatives(slope, bend)
    g[:strains] += by_strain
    h[:strains, :strains] += second
    _unscale(tables, z, (width, slope, bend), g, h)
    work.gradient[:] = g[:strains].T
    work.hessian[:] = h[:strains, :strains].T


def balance(
    tables: Tables,
    z: FloatArray,
    tensions: FloatArray,
    wrench: FloatArray,
    tolerance: float,
    work: Work,
) -> tuple[float, int]:
    """Find the twists ``z`` at which every section balances ``wrench`` (N, m).

    Return an estimate of the largest residual after the last step, and the number of steps.
    """
    if not z[0, 3]:
        z[:] = initial_twists(tables, tensions, z.shape[1])
    scale = force_scale(tables, tensions)
    step, residual = np.zeros_like(z), np.inf
    slope, last = np.zeros((2, len(z)))
    for steps in range(1, _MOST_BALANCE + 1):
        sections(tables, z, tensions, work)
        np.subtract(work.gradient, wrench, out=work.residual)
        residuals = _relative_residuals(wrench, scale, work).max(axis=1)
        residual = float(residual_left(residuals, last).max())
        if residual <= tolerance:
            z += _section_steps(work)
            return residual, steps
        last = residuals
        if steps > 1:
            along = (work.residual * step).sum(axis=1)
            is_accepted = (along <= _OVERSHOOT * slope) | (residuals <= _ROUNDING)  # False for NaN
            if not is_accepted.all():
                step = np.where(is_accepted[:, np.newaxis], step, _SHORTENED * step)
                slope = np.where(is_accepted, slope, _SHORTENED * slope)
                z -= np.where(is_accepted[:, np.newaxis], 0.0, step)
                last = np.zeros(len(z))  # a shortened step tells nothing of the convergence
                continue
        step = _section_steps(work)
        slope = -(work.residual * step).sum(axis=1)
        z += step
    return residual, _MOST_BALANCE


def _section_steps(work: Work) -> FloatArray:
    """Return Newton's step of every cross section by itself, (n, m), by L D L^T."""
    h, x = np.array(work.hessian.T, order='C'), -work.residual.T
    count = len(x)
    for a in range(count - 1):
        row = h[a, a + 1 :] / h[a, a]
        x[a + 1 :] -= row * x[a]
        h[a + 1 :, a + 1 :] -= row[:, np.newaxis] * h[a, a + 1 :]
    for a in range(count - 1, -1, -1):
        x[a] /= h[a, a]
        x[:a] -= h[a, :a] * x[a]
    return x.T


def initial_twists(tables: Tables, tensions: FloatArray, strains: int) -> FloatArray:
    """Return twists (n, m) near the balance under ``tensions`` (n, J) [N].

    They are those of tendons parallel to the midline. Force and moment then do not depend on the
    strain, and the section bends in one plane.
    """
    body, axial = tables.body.T, tables.body[:, AXIAL]
    radii = np.sqrt(body[SQUARED_N : SQUARED_B + 1])
    pull = tensions * tables.reach
    force = pull.sum(axis=1) / axial
    paths = tables.tendons[..., [ALONG_B, ALONG_N]] * (1.0, -1.0)
    about = (pull[..., np.newaxis] * paths).sum(axis=1).T / (axial * radii)
    moment = np.hypot(*about)
    straight, stretch, curvature = bent_by(tables.law, force, moment)
    # The scaled curvatures; the moments of the tendons' pull have the opposite sign.
    bends = about * (-curvature / np.maximum(moment, 1e-300)) / radii
    fails = ~(stretch > np.hypot(*bends) * body[LEVER])
    stretch, bends = np.where(fails, straight, stretch), np.where(fails, 0.0, bends)
    width, _, _ = widening(tables.law, stretch)
    bend, _ = rest_bend(tables.law, stretch)
    z = np.zeros((len(tensions), strains))
    z[:, 0] = body[REST_T]
    z[:, 1:3] = ((bends + bend * body[REST_T + 1 :]) / width).T
    z[:, 3] = stretch
    return z


def relative_residual(wrench: FloatArray, scale: FloatArray, work: Work) -> float:
    """Return the largest residual over its scale plus the largest ``wrench`` (N, m) of the arm."""
    return float(_relative_residuals(wrench, scale, work).max(initial=0.0))


def _relative_residuals(wrench: FloatArray, scale: FloatArray, work: Work) -> FloatArray:
    """Return the relative residual of every cross section and component, (N, m)."""
    scale = scale.repeat(3, axis=1)[:, : wrench.shape[1]] + np.abs(wrench).max(axis=0)
    return np.abs(work.residual) / scale


# Tendons with friction -------------------------------------------------------------------------


class Bends:
    """The curvature of tendons in space.

    Attributes:
        bend: derivative by s of the unit tangents, in the axes of the section, (3, n, J) [1/m].
        rate: length of ``bend``, zero beyond the anchorage, (n, J) [1/m].
        is_rough: whether ``bend`` turns so far within an element that its length is taken at fine
            points, (E, J).
        kink: jumps of the unit tangents at the starts of elements, or zero, (3, E, J).
    """

    def __init__(self, tables: Tables, z: FloatArray, unit: FloatArray, reach: FloatArray) -> None:
        """Differentiate the ``unit`` tangents (3, n, J); ``reach`` (n, J) is 1 where they act."""
        elements = tables.lengths.size
        by_element = unit.reshape(3, elements, len(tables.to_end), unit.shape[2])
        slope = tables.differentiation @ by_element
        slope /= tables.lengths[:, np.newaxis, np.newaxis]
        self.bend = slope.reshape(unit.shape)
        self.bend += cross(z[:, np.newaxis, :3], unit.transpose(1, 2, 0)).transpose(2, 0, 1)
        self.rate = np.sqrt((self.bend * self.bend).sum(axis=0)) * reach
        ends = self.bend.reshape(by_element.shape)[:, :, [0, -1]]
        size = self.rate.reshape(elements, len(tables.to_end), unit.shape[2])[:, [0, -1]]
        along = (ends[:, :, 0] * ends[:, :, 1]).sum(axis=0)
        self.is_rough = along < ROUGH * size[:, 0] * size[:, 1]
        ends = tables.ends @ by_element
        self.kink = np.zeros((3, elements, unit.shape[2]))
        self.kink[:, 1:] = ends[:, 1:, 0] - ends[:, :-1, 1]
        self.kink *= tables.sharp[:, np.newaxis] * reach[:: len(tables.to_end)]

    @property
    def kink_angles(self) -> FloatArray:
        """The angles of the jumps `kink`, (E, J) [rad]."""
        size = 0.5 * np.sqrt((self.kink * self.kink).sum(axis=0))
        return np.asarray(2.0 * np.arcsin(np.minimum(size, 1.0)))


def tendons_at(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> PulledTendons:
    """Return the tendons under ``tensions`` (n, J) [N], which also displace them in sheaths."""
    width, _, _ = widening(tables.law, z[:, 3])
    return PulledTendons(tables, _scaled(z, width), width, tensions, work)


def angles(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Compute the angle (n, J) [rad] by which every tendon turns between base and node."""
    tendons, elements = tendons_at(tables, z, tensions, work), tables.lengths.size
    pulled = tendons.pulled
    bends = Bends(tables, z, tendons.unit.swapaxes(1, 2), tables.reach[:, pulled])
    rate = bends.rate.reshape(elements, len(tables.to_end), bends.rate.shape[1])
    kinks = bends.kink_angles.cumsum(axis=0)
    whole = tables.weights[: len(tables.to_end)] / tables.lengths[0] @ rate
    angle = tables.to_point @ rate
    by_element = bends.bend.reshape(3, *rate.shape)
    for e, j in zip(*np.nonzero(bends.is_rough)):
        fine = tables.to_fine @ by_element[:, e, :, j].T
        fine = tables.fine_weights @ np.sqrt((fine * fine).sum(axis=1))
        angle[e, :, j], whole[e, j] = fine[:-1], fine[-1]
    angle *= tables.lengths[:, np.newaxis, np.newaxis]
    whole *= tables.lengths[:, np.newaxis]
    kinks += whole.cumsum(axis=0) - whole
    work.angle[:] = 0.0
    angle += kinks[:, np.newaxis]
    rubs = tables.reach[:, pulled] * (tables.friction[pulled] > 0.0)
    work.angle[:, pulled] = angle.reshape(bends.rate.shape) * rubs
