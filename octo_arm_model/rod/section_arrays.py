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

_MOST_STEPS = 30  # of the offset of a tendon in its sheath
ROUGH = 0.5  # cosine between bends of a tendon at the ends of an element, from which see `Bends`
_SETTLED = 1e-14  # change of an offset, over the lever
_MOST_BALANCE = 200  # steps to the balance of a section
_ROUNDING = 1e-6  # residual below which steps are taken as they are
_SHORTENED = 0.5  # factor of a step that is too long
_OVERSHOOT = 0.9  # of the slope along a step, that may be left with the other sign at its end
# Indices for a cross product by one multiplication of permuted components.
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products along the last axis."""
    found: FloatArray = a[..., NEXT] * b[..., LAST] - a[..., LAST] * b[..., NEXT]
    return found


class PulledTendons:
    """The tendons under tension at all nodes, and their u.

    Attributes:
        tension: (J, n) [N], zero beyond the anchorage.
        pulled: which of all tendons these are, (J,).
        strain: the six scaled strains, (6, n).
        unit: c = u / |u|, (3, J, n).
        over: 1 / |u|, (J, n).
    """

    def __init__(
        self,
        tables: Tables,
        strain: FloatArray,
        width: FloatArray,
        tensions: FloatArray,
        work: Work,
    ) -> None:
        """Of scaled ``strain`` (6, n)."""
        tension = (tensions * tables.reach).T
        # Those that nobody pulls are left out.
        self.pulled = np.flatnonzero(tension.any(axis=1))
        if not self.pulled.size:
            self.pulled = np.array([0])  # Arrays without tendons have no shape to go by.
        self.tension = np.ascontiguousarray(tension[self.pulled])
        # x, y, dx, dy and 1, of which u and its derivatives are linear.
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
        d, left = np.stack([guess * b, -guess * n]), np.full(x.shape, np.inf)
        for _ in range(_MOST_STEPS):
            u_t, u_n, u_b = self._along(x + d[0], y + d[1])
            inverse = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
            p_n, p_b = (t * u_b - b * u_t) * inverse, (n * u_t - t * u_n) * inverse
            r_n, r_b = d[0] + yielding * p_n, d[1] + yielding * p_b
            nn, nb, bb = offset_stiffness((t, n, b), (p_n, p_b), yielding * inverse)
            inverse = 1.0 / (nn * bb - nb * nb)
            step = np.stack([(bb * r_n - nb * r_b) * inverse, (nn * r_b - nb * r_n) * inverse])
            # A tendon stays where its own iteration has ended.
            d = d - np.where(left * left > _SETTLED, step, 0.0)
            now = np.abs(step).sum(axis=0) / lever
            left = np.where(left * left > _SETTLED, now, left)
            if not (left * left > _SETTLED).any():
                break
        return np.where(left * left <= _SETTLED, d, np.nan)

    def by_strain(self, slope: FloatArray) -> FloatArray:
        """Gradient of |u| by the scaled strain, (m, J, n)."""
        u_t, u_n, u_b = self.unit
        found = np.empty((self._strains, *u_t.shape))
        found[0] = self.x * u_b - self.y * u_n
        found[1], found[2] = self.y * u_t, -self.x * u_t
        found[3] = u_t + slope * self._winding
        found[4:] = self.unit[1 : self._strains - 3]
        return found

    def derivatives(self, slope: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (m, n) and Hessian (m, m, n) of the energy of tendons and sheaths.

        By the scaled strains; of the four without shear where there is none.
        """
        by, strains, weight = self.by_strain(slope), self._strains, self.tension * self.inverse
        path = self._path.copy()
        path[2:4] *= slope
        squares = np.einsum('kjn,ljn->kln', weight * path, path)
        found = (_SQUARES[strains] @ squares.reshape(25, -1)).reshape(strains, strains, -1)
        found -= np.einsum('ajn,cjn->acn', weight * by, by)
        found[3, 3] += bend * np.einsum('jn,jn->n', self.tension, self._winding)
        if self.compliance.any():
            found -= self._condensed(np.einsum('ack,kjn->cajn', _BY[:strains], path), by)
        return np.einsum('ajn,jn->an', by, self.tension), found

    def _condensed(self, by: FloatArray, g: FloatArray) -> FloatArray:
        """C D^-1 C^T of the offsets in sheaths, (m, m, n)."""
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
        moved = factor * np.stack([bb * mixed[0] - nb * mixed[1], nn * mixed[1] - nb * mixed[0]])
        return np.asarray(np.einsum('dajn,dcjn->acn', mixed, moved))


# From x, y, slope dx, slope dy and 1 to du/de by the six scaled strains, (6, 3, 5), and from
# their products to those of four or all of these, (16 or 36, 25).
_BY = np.zeros((6, 3, 5))
_BY[[0, 2], [1, 0], [1, 0]] = -1.0
_BY[[0, 1, 3, 3, 3, 4, 5], [2, 0, 0, 1, 2, 1, 2], [0, 1, 4, 2, 3, 4, 4]] = 1.0
_SQUARES = {m: np.einsum('ack,bcl->abkl', _BY[:m], _BY[:m]).reshape(-1, 25) for m in (4, 6)}


def _scaled(z: FloatArray, width: FloatArray) -> FloatArray:
    """The six scaled strains, (6, n)."""
    strain = np.zeros((6, len(z)))
    strain[: z.shape[1]] = z.T
    strain[:3] *= width
    return strain


_Density: TypeAlias = tuple[Number, Number, Number, Number, Number]


def _from_rest(tables: Tables, strain: FloatArray, width: FloatArray) -> FloatArray:
    """Scaled strains (6, n) less those at rest, the given ones of a rod that is straight there."""
    rest = tables.body[:, REST_T:].T
    if not rest.any():
        return strain
    bend, _ = rest_bend(tables.law, strain[3])
    strain = strain.copy()
    strain[:3] -= np.stack([width, bend, bend]) * rest
    return strain


def _density_at(tables: Tables, strain: FloatArray) -> _Density:
    """`density` of scaled strains (6, n)."""
    squares = tables.body[:, SQUARED_N : SQUARED_B + 1].T
    bend = (strain[1:3] * strain[1:3] * squares).sum(axis=0)
    return density(tables.law, strain[3], bend)


def _stress(tables: Tables, strain: FloatArray, parts: _Density) -> FloatArray:
    """Gradient of the energy of the material by the scaled strain (6, n), (6, n)."""
    body, (by_stretch, by_bend, *_) = tables.body.T, parts
    found = strain.copy()
    found[0] *= body[TORSION]
    found[1:3] *= 2.0 * body[AXIAL] * by_bend * body[SQUARED_N : SQUARED_B + 1]
    found[3] = body[AXIAL] * by_stretch
    found[4:] *= body[SHEAR]
    return found


def _stiffness(tables: Tables, strain: FloatArray, parts: _Density) -> FloatArray:
    """Hessian of the energy of the material by the scaled strain (6, n), (6, 6, n)."""
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
    """What the bend at rest, which changes with the stretch, adds to the rows of the stretch.

    Of the gradient (6, n) and the Hessian (6, 6, n) of the energy of the material.
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
    """From gradient (m, n) and Hessian (m, m, n) by the scaled strain to those by the twist."""
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
    """Gradient of the energy of every cross section."""
    strains, (width, slope, bend) = z.shape[1], widening(tables.law, z[:, 3])
    strain = _scaled(z, width)
    own = _from_rest(tables, strain, width)
    g = _stress(tables, own, _density_at(tables, own))
    _add_rest(tables, strain, (width, slope, bend), g)
    tendons = PulledTendons(tables, strain, width, tensions, work)
    g[:strains] += np.einsum('ajn,jn->an', tendons.by_strain(slope), tendons.tension)
    _unscale(tables, z, (width, slope, bend), g)
    work.gradient[:] = g[:strains].T


def sections(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Gradient and Hessian of the energy of every cross section by the twist."""
    strains, (width, slope, bend) = z.shape[1], widening(tables.law, z[:, 3])
    strain = _scaled(z, width)
    own = _from_rest(tables, strain, width)
    parts = _density_at(tables, own)
    g, h = _stress(tables, own, parts), _stiffness(tables, own, parts)
    _add_rest(tables, strain, (width, slope, bend), g, h)
    tendons = PulledTendons(tables, strain, width, tensions, work)
    by_strain, twice = tendons.derivatives(slope, bend)
    g[:strains] += by_strain
    h[:strains, :strains] += twice
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
    """Bring every cross section to balance with ``wrench`` (N, m), see `loops`."""
    if not z[0, 3]:
        z[:] = initial_twists(tables, tensions, z.shape[1])
    scale = force_scale(tables, tensions)
    step, left = np.zeros_like(z), np.inf
    slope, last = np.zeros((2, len(z)))
    for steps in range(1, _MOST_BALANCE + 1):
        sections(tables, z, tensions, work)
        np.subtract(work.gradient, wrench, out=work.residual)
        sizes = _relative_residuals(wrench, scale, work).max(axis=1)
        left = float(residual_left(sizes, last).max())
        if left <= tolerance:
            z += _section_steps(work)
            return left, steps
        last = sizes
        if steps > 1:
            along = (work.residual * step).sum(axis=1)
            fine = (along <= _OVERSHOOT * slope) | (sizes <= _ROUNDING)  # False for NaN
            if not fine.all():
                step = np.where(fine[:, np.newaxis], step, _SHORTENED * step)
                slope = np.where(fine, slope, _SHORTENED * slope)
                z -= np.where(fine[:, np.newaxis], 0.0, step)
                last = np.zeros(len(z))  # nothing is known of how this converges
                continue
        step = _section_steps(work)
        slope = -(work.residual * step).sum(axis=1)
        z += step
    return left, _MOST_BALANCE


def _section_steps(work: Work) -> FloatArray:
    """Newton's step of every cross section alone, (n, m), by L D L^T."""
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
    """Twists (n, m) near the balance under ``tensions`` (n, J) [N], as if tendons were parallel.

    Force and moment then do not depend on the strain, and the section bends in one plane.
    """
    body, axial = tables.body.T, tables.body[:, AXIAL]
    radii = np.sqrt(body[SQUARED_N : SQUARED_B + 1])
    pull = tensions * tables.reach
    force = pull.sum(axis=1) / axial
    paths = tables.tendons[..., [ALONG_B, ALONG_N]] * (1.0, -1.0)
    about = (pull[..., np.newaxis] * paths).sum(axis=1).T / (axial * radii)
    moment = np.hypot(*about)
    straight, stretch, curvature = bent_by(tables.law, force, moment)
    # Scaled curvatures; moments are those of the tendons' pull with opposite sign.
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
    """Largest residual over its scale and the largest ``wrench`` (N, m) along the arm."""
    return float(_relative_residuals(wrench, scale, work).max(initial=0.0))


def _relative_residuals(wrench: FloatArray, scale: FloatArray, work: Work) -> FloatArray:
    """The same of every cross section and component, (N, m)."""
    scale = scale.repeat(3, axis=1)[:, : wrench.shape[1]] + np.abs(wrench).max(axis=0)
    return np.abs(work.residual) / scale


# Tendons with friction -------------------------------------------------------------------------


class Bends:
    """How tendons turn in space.

    Attributes:
        bend: derivative by s of their unit tangents, in the axes of the section, (3, n, J) [1/m].
        rate: its length, (n, J) [1/m], zero beyond the anchorage.
        is_rough: where a bend turns so far within an element that its length is taken at fine
            points, (E, J).
        kink: jumps of the unit tangents at the starts of elements, (3, E, J), zero where there
            is none.
    """

    def __init__(self, tables: Tables, z: FloatArray, unit: FloatArray, reach: FloatArray) -> None:
        """Of tendons of ``unit`` tangents (3, n, J) that act where ``reach`` (n, J) is 1."""
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
        """Angles of the `kink`, (E, J) [rad]."""
        size = 0.5 * np.sqrt((self.kink * self.kink).sum(axis=0))
        return np.asarray(2.0 * np.arcsin(np.minimum(size, 1.0)))


def tendons_at(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> PulledTendons:
    """Those under ``tensions`` (n, J) [N], which displace them in sheaths."""
    width, _, _ = widening(tables.law, z[:, 3])
    return PulledTendons(tables, _scaled(z, width), width, tensions, work)


def angles(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Angle by which every tendon has turned between the base and every node, see `loops`."""
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
