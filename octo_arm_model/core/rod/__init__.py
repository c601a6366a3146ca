"""The curve and its discretisation: grid, quadrature, kinematics, backbone. Imports arm."""
