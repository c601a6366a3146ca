"""The arms that come with the package, and files of others."""

from __future__ import annotations

import os
from pathlib import Path

from octo_arm_model.arm.errors import ConfigError, shown


def find_path(name: str | Path) -> Path:
    """Parameter file ``name``, or that of the preset where ``name`` is no path.

    A path has a suffix or a folder, or exists.

    Raises:
        ConfigError: if there is no such preset.
    """
    path = Path(name)
    is_path = path.suffix or len(path.parts) > 1 or os.path.exists(name)
    return path if is_path else preset_path(str(name))


def preset_path(name: str) -> Path:
    """Parameter file of a preset arm such as ``renda2012_table4``, in a checkout or installed.

    Raises:
        ConfigError: if there is no such preset; the message lists those there are.
    """
    for parent in Path(__file__).resolve().parents[1:]:
        for folder in (parent / 'config', parent / 'share' / 'octo_arm_model' / 'config'):
            if (folder / 'renda2012_table4.yaml').is_file():
                names = {file.stem for file in folder.glob('*.yaml')} - {'simulator'}
                if name in names:
                    return folder / f'{name}.yaml'
                known = ', '.join(sorted(names))
                raise ConfigError(f'no preset arm {shown(name)}, expected one of {known}')
    raise ConfigError(f'no preset arm {shown(name)}: the presets are not installed')
