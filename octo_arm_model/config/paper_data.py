"""The tensions printed in Renda et al. 2012, for figures, demonstrations and tests."""

Tensions = tuple[tuple[float, float, float, float], ...]

_SLACK = (0.0, 0.0, 0.0, 0.0)
_ROOT_3 = 3.0**0.5

# Table 3, by panel of Figure 11 [N]; the arm is renda2012_table2.
BENDING: dict[str, Tensions] = {
    'A': ((0.0, 0.0, 1.0, 1.0), _SLACK, _SLACK),
    'B': ((1.0, _ROOT_3, 0.0, 0.0), _SLACK, _SLACK),
    'C': ((0.0, 1.0, _ROOT_3, 0.0), _SLACK, _SLACK),
}

# Table 5, by figure [N]; the arm is renda2012_table4.
FETCHING_IN_PLANE: Tensions = ((0.0, 0.0, 0.5, 0.0), (4.0, 0.0, 0.0, 0.0), (0.0, 0.0, 13.0, 0.0))
FETCHING_IN_SPACE: Tensions = ((0.0, 0.0, 0.5, 0.0), (4.0, 0.0, 0.0, 0.0), (0.0, 13.0, 0.0, 0.0))

# Table 1: the tension of the one pulled tendon of renda2012_prototype [N], and the measured
# distance between the tips of the real arm and of the paper's model [% of the length].
PROTOTYPE_ERRORS: dict[float, float] = {
    0.53: 3.0,
    1.09: 5.5,
    2.00: 3.5,
    2.60: 6.7,
    3.06: 7.8,
    3.44: 7.0,
    3.95: 4.8,
}
PROTOTYPE_AVERAGE_ERROR = 5.4  # as printed below them
PROTOTYPE_IN_FIGURE_9 = 3.0  # [N]
