"""The rod: one residual and one Jacobian, from which every answer of the model `exact` follows.

Unknowns are the twists z = (kappa_t, kappa_n, kappa_b, stretch[, v_n, v_b]) per reference length
at N nodes, p Gauss-Legendre points in each of E elements. With the orientation R(z), r' = R v and
the wrench of everything beyond a node, F and M = M_free + integral from it to the tip of r' x F,

    residual = d psi(z; T) / dz - (R^T M, t . F[, n . F, b . F]),    Jacobian = d residual / dz

where psi is the energy of the cross section with its tendons, see `loops`. Arrays over nodes go
from the base to the tip and have the node as first axis.

`elements`      where the nodes are: elements between anchorages, knots and loads, by the radius
`tables`        `Tables` of an arm at its nodes and `Work`, the arrays that node functions fill in
`loops`         the node functions as loops for numba
`arrays`        the same over whole arrays for NumPy
`forms`         which of the two is used
`dead_loads`    F and M_free of dead loads at the nodes
`other_loads`   the same of loads of a user's own, and their derivatives by the shape
`load_limits`   bounds of loads and tensions
`factors`       LU factors of the Jacobian, and whether its symmetric part is positive definite
`equilibrium`   `Problem` (tables, loads, form) and `State`: residual, Jacobian, stability
`unloaded`      the balance of every cross section by itself
`newton`        chord steps and Newton's method
`continuation`  following equilibria, and descent to the next where a branch ends
`checks`        what a solution is refused for
`rod`           `Rod`: from tensions and a wrench on the tip to a `State`
`read_out`      positions, orientations and strains at stations

What comes next enters as a term of these, and changes no signature:

* Friction: node functions take the tension of every tendon at every node, (N, tendons); a fixed
  point makes it anew from the angles of the same z. `Condition.tensions` may have that shape.
* Sheaths: the offset of a tendon is condensed within its section; see `Tables.compliance`.
* Winches: rows and columns around `Factors.solve`; the columns are gradients of tendons' lengths.
* Loads that follow the shape: F and M_free are arguments of `residual`, made anew in
  `Problem.evaluate` from `Work.rotation` and `Work.slope`; their derivatives are added to
  `Work.jacobian` in `Problem.fill_jacobian`. Inertia, drag and contact are such loads; those of a
  user's own are in `other_loads`.
"""
