"""A new kind of measurement: strains of fibres beside the midline, for a force on the tip."""

import numpy as np

from octo_arm_model import load_config
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Measurement, Tensions
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.unknowns import Unknowns, Walk


class FibreStrain(Measurement):
    """The strain [-] of a fibre along the arm at (y, z) [m] in the cross section of a station."""

    name = 'fibre strain'

    def __init__(self, station: int, y: float, z: float, value: float, noise: float) -> None:
        """Take the measured ``value`` and its standard deviation ``noise``, both [-]."""
        super().__init__([value], noise)
        self.station, self.y, self.z = station, y, z

    def innovation(self, prediction: Prediction) -> FloatArray:
        """Return the measured strain less the predicted one, (1,) [-]."""
        xi, k, q = (getattr(prediction.solved, name)[self.station] for name in ('xi', 'k', 'q'))
        return self.value - (q + (1.0 + q) * (xi * self.z - k * self.y))

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivative of the predicted strain by the state, (1, states)."""
        xi, k, q = (getattr(prediction.solved, name)[self.station] for name in ('xi', 'k', 'q'))
        _, by_xi, by_k, by_q = prediction.change.strain[self.station]
        bent = 1.0 + xi * self.z - k * self.y
        return (bent * by_q + (1.0 + q) * (self.z * by_xi - self.y * by_k))[np.newaxis]


config = load_config('renda2012_prototype')
true = config.solver('exact', stations=31).solve([[2, 0, 0, 0]], [0, 0, 0.004, 0, 0, 0])
fibres = []
for y, z in ((0.005, 0.0), (0.0, 0.005)):  # at a tenth of the length
    strain = true.q[3] + (1.0 + true.q[3]) * (true.xi[3] * z - true.k[3] * y)
    fibres.append(FibreStrain(3, y, z, strain, 1e-4))
model = ArmModel.of(config, Unknowns(Walk(5.0), tip_force=Walk.stationary(0.01, 1.0)), stations=31)
measured = [Tensions([2.0, 0.0, 0.0, 0.0], 0.002), *fibres]
estimate = Estimator({'tip': model}).add(0, measured).estimate
force = ' '.join(f'{1e3 * part + 0.0:.2f}' for part in estimate.tip_wrench[:3])
print('refused:', estimate.refused, 'force:', force, 'mN')
