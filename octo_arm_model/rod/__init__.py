"""The rod: one residual and one Jacobian, from which every answer of the model `exact` follows.

Unknowns are the twists z = (kappa_t, kappa_n, kappa_b, stretch[, v_n, v_b]) per reference length
at N nodes, p Gauss-Legendre points in each of E elements. With the orientation R(z), r' = R v and
the wrench of everything beyond a node, F and M = M_free + integral from it to the tip of r' x F,

    residual = d psi(z; T) / dz - (R^T M, t . F[, n . F, b . F]),    Jacobian = d residual / dz

where psi is the energy of the cross section with its tendons, see `section_loops`. Arrays over
nodes go from the base to the tip and have the node as first axis.

`elements`       elements between anchorages, knots and loads, graded by the radius; their nodes
`tables`         `Tables` of an arm at its nodes and `Work`, the arrays that node functions fill in
`loops`          the node functions as loops for numba
`arrays`         the same over whole arrays for NumPy; `section_loops`, `section_arrays`: of cross
                 sections, by `section_formulas`; `angle_loops`: of wrap angles; `inertia_loops`:
                 of motion; `paper_loops`: of the paper's models; `compiled`: how numba compiles
`forms`          the choice of one of these two forms
`tendons`        paths of tendons at the nodes, their lengths, and the derivatives of both
`loads`          F and M_free of all loads at the nodes, and their derivatives by the shape;
                 `contact`: those of obstacles; `discs`: of tendons that discs hold
`friction`       tension of every tendon at every node, and its derivatives
`factors`        LU factors of the Jacobian, and whether its symmetric part is positive definite
`equilibrium`    `Problem` (tables, loads, form) and `State`: residual, Jacobian, stability; the
                 balance of every cross section by itself; `Equilibrium`
`continuation`   chord steps and Newton's method; following equilibria, and descent to the next
                 where a branch ends
`checks`         shapes and bounds of input, and reasons to refuse a solution
`backbone`       `Backbone`: the result; positions, orientations and strains at stations
`rod`            `Rod`: from tensions and a wrench on the tip to an `Equilibrium`
`winches`        `Winches`: equilibria of tendons at given lengths, some of which may be slack,
                 by Newton's method on `winch_equations`
`sensitivity`    first derivatives of an equilibrium, and the covariance of its tip

`statics`        the interface of every model, and `Exact`, which uses all of the above
`papers`         the paper's models on the same nodes
`rotations`      rotation vectors and quaternions
`solver`         `Solver`: one arm or a batch, quantities of solutions; `solve` in one call
`stations`       places of results
`displacements`  tendons at given lengths: shapes and derivatives, for a user

`motion`         `Dynamics`: implicit time steps; `motion_state`: their inputs and results
`inertia`        the same equations with inertia, drag, added mass and viscosity, and their
                 derivatives
`modes`          natural modes about an equilibrium, and its linear model

A new effect is a term of these. It changes no signature:

* Loads that follow the shape, such as inertia, drag and contact: `Problem.evaluate` computes F and
  M_free, the arguments of `wrenches`; `Problem.fill_jacobian` adds their derivatives by the shape
  to `Work.jacobian`.
* A tension that changes along a tendon, as by `friction`: node functions take the tension of every
  tendon at every node, (N, J); `Problem.evaluate` computes it from z, and `Problem.fill_jacobian`
  adds its derivatives.
* An unknown of a cross section, such as the offset of a tendon in its sheath: it is condensed
  within the section.
* An unknown of the whole arm: a row and a column around `Factors.solve`, as in `winch_equations`.

May import arm.
"""
