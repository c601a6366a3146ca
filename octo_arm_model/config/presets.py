"""The arms that come with the package, and files of others."""

from __future__ import annotations

from pathlib import Path

from octo_arm_model.config.config import Config, load_config
from octo_arm_model.core.errors import ConfigError


def find_config(name: str) -> Config:
    """Configuration from a file, or from a preset where ``name`` is no path.

    Raises:
        ConfigError: if there is neither, or it does not describe an arm.
    """
    return load_config(find_path(name))


def find_path(name: str) -> Path:
    """Parameter file ``name``, or that of the preset where ``name`` is no path.

    Raises:
        ConfigError: if there is no such preset.
    """
    is_path = Path(name).suffix or len(Path(name).parts) > 1 or Path(name).exists()
    return Path(name) if is_path else preset_path(name)


def preset_path(name: str) -> Path:
    """Parameter file of a preset arm such as ``renda2012_table4``, in a checkout or installed.

    Raises:
        ConfigError: if there is no such preset; the message lists those there are.
    """
    for parent in Path(__file__).resolve().parents[1:]:
        for folder in (parent / 'config', parent / 'share' / 'octo_arm_model' / 'config'):
            if (folder / 'renda2012_table4.yaml').is_file():
                path = folder / f'{name}.yaml'
                if path.is_file():
                    return path
                names = {file.stem for file in folder.glob('*.yaml')} - {'simulator'}
                known = ', '.join(sorted(names))
                raise ConfigError(f'no preset arm {name!r}, expected one of {known}')
    raise ConfigError(f'no preset arm {name!r}: the presets are not installed')
