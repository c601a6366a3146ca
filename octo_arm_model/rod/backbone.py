"""The shape of an arm: the result of every solve."""

from __future__ import annotations

from dataclasses import dataclass

from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.rod import Equilibrium


@dataclass(frozen=True, eq=False)
class Backbone:
    """Shape of the arm at every station, from base to tip. Its arrays are read-only.

    The leading axes are those of the tensions; ``s`` and ``section`` are common to a batch.

    Attributes:
        model: name of the model.
        s: arc coordinate along the reference configuration [m], (stations,).
        section: section a station belongs to, numbered from the tip; 0 beyond the last
            anchorage, (stations,). Values at an anchorage are those on the side of the base.
        position: position of the cross section [m], (..., stations, 3).
        quaternion: its orientation x, y, z, w, (..., stations, 4); the local x axis is the
            tangent t, y is n and z is b.
        tau: torsion about t [1/m], (..., stations).
        xi: curvature about n [1/m], (..., stations).
        k: curvature about b [1/m], (..., stations).
        q: longitudinal strain [-], (..., stations).
        tensions: tensions of the tendons [N], ``(..., *Arm.tension_shape)``.
        tip_wrench: force and moment on the tip in base_frame [N, N m], (..., 6).
        residual: relative residual of the model's equations [-], (...).
        iterations: iterations of the solver, (...).
        equilibrium: of a single arm, from which `Solver.solve` continues as ``start``; None for a
            batch.
        reach: local tension over that at the base of each tendon, without friction: 1 up to its
            anchorage and 0 beyond, (stations, tendons).
        slid_tensions: tensions of tendons with friction at the stations [N], (..., stations,
            tendons); None without friction.
        point_tensions: tensions at the points of the model [N], (tendons, points): the history
            from which `Solver.follow` continues. Of a single arm whose tendons have friction.
    """

    model: str
    s: FloatArray
    section: IntArray
    position: FloatArray
    quaternion: FloatArray
    tau: FloatArray
    xi: FloatArray
    k: FloatArray
    q: FloatArray
    tensions: FloatArray
    tip_wrench: FloatArray
    residual: FloatArray
    iterations: IntArray
    equilibrium: Equilibrium | None = None
    reach: FloatArray | None = None
    slid_tensions: FloatArray | None = None
    point_tensions: FloatArray | None = None

    @property
    def tendon_tensions(self) -> FloatArray:
        """Tension of every tendon at every station [N], (..., stations, tendons).

        The tension at the base less the loss by friction, and 0 beyond the anchorage.
        """
        if self.slid_tensions is not None:
            return self.slid_tensions
        assert self.reach is not None
        lead = self.position.shape[:-2]
        return self.tensions.reshape(*lead, 1, self.reach.shape[-1]) * self.reach

    @property
    def twist(self) -> FloatArray | None:
        """Motion of the frame per reference length at the nodes of the model, (4 or 6, nodes).

        In its own axes: angular (1 + q) (tau, xi, k) [1/m], then linear 1 + q [-] along t, and
        shear along n and b, if any. None for a batch.
        """
        return None if self.equilibrium is None else self.equilibrium.state.z.T

    @property
    def tip(self) -> FloatArray:
        """Position of the tip [m], (..., 3)."""
        return self.position[..., -1, :]
