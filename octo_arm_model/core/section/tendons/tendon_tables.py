"""The direction u of every tendon, linear in the scaled strain and the widening of the section.

See `energy` for u; the widening follows from the stretch, and is taken as one strain more here.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number


class TendonTables:
    """Derivatives of u by n strains and the widening.

    Of batches of one arm, or of many where tendons have left their paths.

    Attributes:
        by: the derivatives, (3, n + 1, tendons, batch, nodes).
        products: of each two of them, (n + 1, n + 1, tendons, batch, nodes).
    """

    def __init__(
        self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, strains: int
    ) -> None:
        """Of tendons at offsets ``x`` and ``y`` of slopes ``dx`` and ``dy``."""
        self.by = by = np.zeros((3, strains + 1, *x.shape))
        by[1, 0], by[2, 0], by[0, 1], by[0, 2] = -y, x, y, -x
        for component in range(strains - 3):
            by[component, 3 + component] = 1.0
        by[1, strains], by[2, strains] = dx, dy
        self.products: FloatArray = np.einsum('cmjbn,ckjbn->mkjbn', by, by)

    def directions(self, strain: FloatArray, width: Number) -> tuple[FloatArray, FloatArray]:
        """Of all tendons u, (3, tendons, batch, nodes), and its length."""
        extended = np.empty((len(strain) + 1, *strain.shape[1:]))
        extended[:-1], extended[-1] = strain, width
        u = np.einsum('cmj...,m...->cj...', self.by, extended)
        return u, np.sqrt(np.einsum('cj...,cj...->j...', u, u))


def by_strain(by: FloatArray, slope: Number) -> FloatArray:
    """Derivatives (n, ...) by the strain alone, of those ``by`` strain and widening.

    ``slope`` is the derivative of the widening by the stretch; ``by`` is written over.
    """
    by[3] += slope * by[-1]
    return by[:-1]
