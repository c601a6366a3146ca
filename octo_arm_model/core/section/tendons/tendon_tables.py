"""The vector u of every tendon as a linear function of scaled strain and widening.

See `energy` for u. The widening, a function of the stretch, is treated as one more strain here.
"""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number


class TendonTables:
    """Derivatives of u by the n strains and the widening.

    The axis of the batch has length one unless tendons are displaced from their paths.

    Attributes:
        by: the derivatives, (3, n + 1, tendons, batch, nodes).
    """

    def __init__(
        self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, strains: int
    ) -> None:
        """Tabulate tendons at offsets ``x`` and ``y`` of slopes ``dx`` and ``dy``."""
        self.by = by = np.zeros((3, strains + 1, *x.shape))
        by[1, 0], by[2, 0], by[0, 1], by[0, 2] = -y, x, y, -x
        for component in range(strains - 3):
            by[component, 3 + component] = 1.0
        by[1, strains], by[2, strains] = dx, dy

    @functools.cached_property
    def products(self) -> FloatArray:
        """Scalar products of every pair of derivatives, (n + 1, n + 1, tendons, batch, nodes)."""
        found: FloatArray = np.einsum('cmjbn,ckjbn->mkjbn', self.by, self.by)
        return found

    def directions(self, strain: FloatArray, width: Number) -> tuple[FloatArray, FloatArray]:
        """The u of all tendons, (3, tendons, batch, nodes), and |u|."""
        extended = np.empty((len(strain) + 1, *strain.shape[1:]))
        extended[:-1], extended[-1] = strain, width
        u = np.einsum('cmj...,m...->cj...', self.by, extended)
        return u, np.sqrt(np.einsum('cj...,cj...->j...', u, u))


def by_strain(by: FloatArray, slope: Number) -> FloatArray:
    """Derivatives (n, ...) by the strain, from those ``by`` strain and widening (n + 1, ...).

    ``slope`` is the derivative of the widening by the stretch; ``by`` is overwritten.
    """
    by[3] += slope * by[-1]
    return by[:-1]
