"""The differences of the models for the prototype of section 5.2, with one tendon pulled."""

import numpy as np

from octo_arm_model import MODELS, load_config

config = load_config('renda2012_prototype')
pulls = np.zeros((6, 1, 4))
pulls[:, 0, 0] = np.linspace(0.5, 3.0, 6)
tips = {model: config.solver(model).solve(pulls).tip for model in MODELS}

print('tension [N]   tip from exact [% of L]')
print('           ', *(f'{model:>12}' for model in MODELS))
for index, tension in enumerate(pulls[:, 0, 0]):
    distances = [np.linalg.norm(tips[model][index] - tips['exact'][index]) for model in MODELS]
    print(f'{tension:11.1f} ', *(f'{100 * d / config.arm.length:12.2f}' for d in distances))
