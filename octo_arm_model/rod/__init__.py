"""The rod: one residual and one Jacobian, from which every answer of the model `exact` follows.

Unknowns are the twists z = (kappa_t, kappa_n, kappa_b, stretch[, v_n, v_b]) per reference length
at N nodes, p Gauss-Legendre points in each of E elements. With the orientation R(z), r' = R v and
the wrench of everything beyond a node, F and M = M_free + integral from it to the tip of r' x F,

    residual = d psi(z; T) / dz - (R^T M, t . F[, n . F, b . F]),    Jacobian = d residual / dz

where psi is the energy of the cross section with its tendons, see `section_loops`. Arrays over
nodes go from the base to the tip and have the node as first axis.

`elements`       where the nodes are: elements between anchorages, knots and loads, by the radius
`tables`         `Tables` of an arm at its nodes and `Work`, the arrays that node functions fill in
`loops`          the node functions as loops for numba
`arrays`         the same over whole arrays for NumPy; `section_loops`, `section_arrays`: of cross
                 sections, by `section_formulas`; `angle_loops`: of wrap angles; `paper_loops`,
                 `paper_arrays`: of the paper's models; `compiled`: how numba compiles loops
`forms`          which of the two is used
`tendons`        where tendons run at the nodes, their lengths, and the derivatives of both
`dead_loads`     F and M_free of dead loads at the nodes
`other_loads`    the same of loads of a user's own, and their derivatives by the shape
`friction`       tension of every tendon at every node, and its derivatives
`factors`        LU factors of the Jacobian, and whether its symmetric part is positive definite
`equilibrium`    `Problem` (tables, loads, form) and `State`: residual, Jacobian, stability
`unloaded`       the balance of every cross section by itself
`newton`         chord steps and Newton's method
`continuation`   following equilibria, and descent to the next where a branch ends
`checks`         what a solution is refused for
`resolution`     the error of positions, estimated from the last coefficients in each element
`read_out`       positions, orientations and strains at stations
`rod`            `Rod`: from tensions and a wrench on the tip to an `Equilibrium`
`reeling`        Newton's method for tendons at given lengths, which may be slack
`winches`        `Winches`: equilibria of tendons at given lengths, by `reeling`
`derivatives`    first derivatives of an equilibrium; `sensitivity`: what they are given as

`statics`        what every model gives; `exact` does by all of the above
`papers`         the paper's models on the same nodes; `paper_equations` has their mathematics
`inputs`         shapes and bounds of tensions and loads as they are given
`rotations`      rotation vectors and quaternions
`solver`         `Solver`: one arm or a batch, quantities of solutions; `solve` in one call
`backbone`       `Backbone`: the result; `stations`: where it is known
`displacements`  tendons at given lengths: shapes and derivatives, for a user

`motion`         `Dynamics`: implicit time steps; `motion_state`: what they take and give
`inertia`        the same equations with inertia, drag, added mass and viscosity, and their
                 derivatives; `inertia_loops` and `inertia_arrays` have its node functions
`modes`          natural modes about an equilibrium, and its linear model

A new effect is a term of these. It changes no signature:

* Loads that follow the shape, as inertia, drag and contact would: F and M_free are arguments of
  `residual`, made anew in `Problem.evaluate`; their derivatives by the shape are added to
  `Work.jacobian` in `Problem.fill_jacobian`.
* What changes the tension along a tendon: node functions take the tension of every tendon at
  every node, (N, J), which `Problem.evaluate` makes from z, and `Problem.fill_jacobian` adds its
  derivatives, as for `friction`.
* An unknown of a cross section: condensed within it, as the offset of a tendon in its sheath.
* An unknown of the whole arm: a row and a column around `Factors.solve`, as in `reeling`.

May import arm.
"""
