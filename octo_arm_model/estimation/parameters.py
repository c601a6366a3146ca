"""The table of an estimator's parameters, in addition to those of the arm.

The node declares its ROS parameters from it, the command line its options, and the manual prints
it.
"""

from __future__ import annotations

from octo_arm_model.config.parameter import Parameter
from octo_arm_model.estimation.rules import GATE

CONTACTS = ('tip', 'at', 'somewhere', 'current', 'none')
MAX_PLACES = 50  # of a contact
MAX_MARKERS = 300  # whose coordinates are one measurement
PLACES = 5  # of a contact somewhere, evenly along the arm
BENT = 0.1  # of the length: how far the default of the force moves the tip
RECOVER_AFTER = 1.0  # [s]
CELL_FAULT, SENSOR_FAULT = 0.1, 0.005
TURNED = 2.0  # [rad] by which a tendon turns up to where its friction counts on average
PREFIX = 'estimator.'

ESTIMATOR_PARAMETERS = (
    Parameter('estimator.contact', str,
              'what acts on the arm besides its known loads: tip (a force on the tip), at (a '
              'force at contact_s), somewhere (a force at one of contact_s or nowhere, by their '
              'probabilities), current (uniform, of the surrounding fluid) or none', 'tip',
              range=', '.join(CONTACTS)),
    Parameter('estimator.contact_s', float,
              'arc coordinates of the contact [m]; empty, with somewhere, for '
              f'{PLACES} even steps up to the tip', (), is_array=True,
              range=f'in (0, body.length], at most {MAX_PLACES}', most=MAX_PLACES),
    Parameter('estimator.force_stddev', float,
              'standard deviation of each component of the force before anything is measured [N]; '
              f'0 for the force that moves the tip by {BENT:g} of the length', 0.0, range='>= 0'),
    Parameter('estimator.force_time', float,
              'correlation time of force, moment and current: how long what is found is taken to '
              'go on where nothing is measured [s]', 1.0, range='> 0'),
    Parameter('estimator.change_time', float,
              'with somewhere, mean time after which the contact is at another place [s]', 1.0,
              range='> 0'),
    Parameter('estimator.moment_stddev', float,
              'likewise of each component of a moment on the tip, with tip [N m]; 0 for none', 0.0,
              range='>= 0'),
    Parameter('estimator.current_stddev', float,
              'likewise of the pressure of a current [Pa]; 0 for that of force_stddev over the '
              'arm seen from the side', 0.0, range='>= 0'),
    Parameter('estimator.tension_rate', float,
              'standard deviation of the change of each tension in a second [N]; 0 for what the '
              'tendon is pulled by at most', 0.0, range='>= 0'),
    Parameter('estimator.tension_bias_stddev', float,
              'standard deviation of what each load cell shows too much, constant [N]; 0 for '
              'nothing', 0.0, range='>= 0'),
    Parameter('estimator.tension_bias_rate', float,
              'standard deviation of its change in a second [N]', 0.0, range='>= 0'),
    Parameter('estimator.tension_loss_stddev', float,
              'standard deviation of the logarithm of the tension of each tendon at the base over '
              'that along the arm, as friction changes it, with the correlation time force_time '
              f'[-]; 0 for {TURNED:g} rad times tendons.friction', 0.0, range='>= 0'),
    Parameter('estimator.displacement_stddev', float,
              'standard deviation of tendon_displacements [m]', 2e-4, range='> 0'),
    Parameter('estimator.marker_s', float,
              'arc coordinates of the markers of measured/markers, from the base on [m]', (),
              is_array=True, range=f'in [0, body.length], at most {MAX_MARKERS}',
              most=MAX_MARKERS),
    Parameter('estimator.marker_stddev', float,
              'standard deviation of each coordinate of a marker [m]', 1e-3, range='> 0'),
    Parameter('estimator.tip_position_stddev', float,
              'standard deviation of each coordinate of measured/tip_pose where the message has '
              'no covariance [m]; 0: such a message is refused', 0.0, range='>= 0'),
    Parameter('estimator.tip_rotation_stddev', float,
              'likewise of its rotation vector [rad]; 0: the orientation is not used', 0.0,
              range='>= 0'),
    Parameter('estimator.base_force_stddev', float,
              'standard deviation of each force of measured/base_wrench [N]; 0: its messages are '
              'refused', 0.0, range='>= 0'),
    Parameter('estimator.base_moment_stddev', float,
              'likewise of each moment [N m]', 0.0, range='>= 0'),
    Parameter('estimator.gate', float,
              'probability with which a right measurement is accepted; one that lies farther off '
              'is refused', GATE, range='in (0, 1)'),
    Parameter('estimator.cell_fault', float,
              'how probable it is that one load cell lies, in parts of the probability that all '
              'sensors are right: where others cannot tell, the covariance holds what would be; 0 '
              'for load cells that never lie', CELL_FAULT, range='in [0, 1)'),
    Parameter('estimator.sensor_fault', float,
              'likewise of each other sensor', SENSOR_FAULT, range='in [0, 1)'),
    Parameter('estimator.window', float,
              'how late measurements may come [s]', 0.2, range='>= 0'),
    Parameter('estimator.recover_after', float,
              'for how long sensors have to contradict the estimate, whichever is doubted, for '
              'it to begin anew [s]; 0 for never', RECOVER_AFTER,
              range='>= 0'),
)  # fmt: skip
