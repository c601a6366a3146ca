"""Solve the loaded arm with `scipy.integrate.solve_bvp`, for comparison.

The unknowns are position, orientation and moment in each panel between anchorages. All panels are
mapped onto the same interval and coupled at its ends. The strains at each point follow from the
balance of the cross section with the tendons, by Newton's method for all points at once.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.integrate import solve_bvp

from octo_arm_model import Arm, Body, Loads, Pose, Solver
from octo_arm_model.arm.material import LAWS
from octo_arm_model.rod import arrays
from octo_arm_model.rod.elements import build_elements, panel_ends
from octo_arm_model.rod.tables import tabulate, work_arrays


class LoadedBvp:
    """An arm with tensions, weight and a force on the tip."""

    def __init__(
        self, arm: Arm, tensions: np.ndarray, loads: Loads, law: str, base: Pose = Pose()
    ) -> None:
        """Store the problem and solve the arm without loads, which is the first guess."""
        self._arm, self._law, self._loads, self._base = arm, LAWS[law], loads, base
        self._tensions = np.reshape(tensions, (1, -1))
        self._elements = build_elements(arm)
        self._panels = [
            (start, stop, sum(one.anchorage >= stop for one in arm.sections))
            for start, stop in itertools.pairwise(panel_ends(arm, ()))
        ]
        self._unloaded = Solver(arm, 'exact', 101, base, material=law).solve(tensions)
        self.density = np.array(loads.gravity) * (arm.material.density - loads.fluid_density)

    def force(self, s: np.ndarray) -> np.ndarray:
        """Return the force at s (3, n) [N]: the weight beyond, of a frustum, and the tip force."""
        body = self._arm.body
        assert isinstance(body, Body)
        radius, tip = body.radius(s), body.radius_tip
        volume = np.pi / 3 * (body.length - s) * (radius**2 + radius * tip + tip**2)
        return np.outer(self.density, volume) + np.array(self._loads.tip_force)[:, np.newaxis]

    def tip(self, tol: float, nodes: int = 51) -> np.ndarray:
        """Return the position of the tip [m], (3,)."""
        x = np.linspace(0.0, 1.0, nodes)
        guess = []
        backbone = self._unloaded
        for start, stop, _ in self._panels:
            s = start + x * (stop - start)
            for column in (*backbone.position.T, *backbone.quaternion.T):
                guess.append(np.interp(s, backbone.s, column))
            guess += 3 * [np.zeros(nodes)]
        solution = solve_bvp(self._rates, self._ends, x, np.array(guess), tol=tol, max_nodes=20000)
        if not solution.success:
            raise RuntimeError(solution.message)
        return solution.y[-10:-7, -1]

    def _rates(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        rates = np.empty_like(y)
        for i, (start, stop, section) in enumerate(self._panels):
            s = start + x * (stop - start)
            rows = slice(10 * i, 10 * (i + 1))
            rates[rows] = (stop - start) * self._panel_rates(s, section, y[rows])
        return rates

    def _panel_rates(self, s: np.ndarray, section: int, y: np.ndarray) -> np.ndarray:
        qx, qy, qz, qw = y[3:7]
        rotation = np.array(
            [
                [1 - 2 * (qy**2 + qz**2), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw)],
                [2 * (qx * qy + qz * qw), 1 - 2 * (qx**2 + qz**2), 2 * (qy * qz - qx * qw)],
                [2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx**2 + qy**2)],
            ]
        )
        force = self.force(s)
        wrench = np.empty((4, 1, s.size))
        wrench[:3, 0] = np.einsum('jin,jn->in', rotation, y[7:])
        wrench[3, 0] = np.einsum('jn,jn->n', rotation[:, 0], force)
        (t, n, b, stretch) = self._twist(s, section, wrench)
        forward = stretch * rotation[:, 0]
        rates = np.empty_like(y)
        rates[:3] = forward
        rates[3] = 0.5 * (qw * t + qy * b - qz * n)
        rates[4] = 0.5 * (qw * n + qz * t - qx * b)
        rates[5] = 0.5 * (qw * b + qx * n - qy * t)
        rates[6] = -0.5 * (qx * t + qy * n + qz * b)
        rates[7:] = -np.cross(forward.T, force.T).T
        return rates

    def _twist(self, s: np.ndarray, section: int, wrench: np.ndarray) -> np.ndarray:
        """Return the twists (4, n) at ``s`` (n,) in balance with the ``wrench`` (4, n)."""
        stop = next(stop for _, stop, number in self._panels if number == section)
        at, base = (np.minimum(s, stop), np.full(s.size, section)), np.array([1.0, 0, 0, 0])
        tables = tabulate(self._arm, self._elements, base, law=self._law.number, at=at)
        work = work_arrays(tables, 4, has_jacobian=False)
        pulls = np.broadcast_to(self._tensions, (s.size, self._tensions.size)).copy()
        unloaded = self._unloaded
        twist = np.empty((s.size, 4))
        q = np.interp(s, unloaded.s, unloaded.q)
        for row, name in enumerate(('tau', 'xi', 'k')):
            twist[:, row] = (1 + q) * np.interp(s, unloaded.s, getattr(unloaded, name))
        twist[:, 3] = 1 + q
        wrench_rows = np.ascontiguousarray(wrench.reshape(4, -1).T)
        arrays.balance(tables, twist, pulls, wrench_rows, 1e-12, work)
        return twist.T

    def _ends(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        residual = [first[:3] - self._base.position, first[3:7] - self._base.quaternion]
        for i in range(len(self._panels) - 1):
            residual.append(first[10 * (i + 1) : 10 * (i + 2)] - last[10 * i : 10 * (i + 1)])
        residual.append(last[-3:] - np.array(self._loads.tip_moment))
        return np.concatenate(residual)
