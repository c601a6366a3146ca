"""Configuration of Fast DDS: free the memory of messages that have left its queues."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from pathlib import Path

PROFILES = Path(__file__).with_name('fastdds.xml')
_FILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
_FROM_XML = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
# A user who sets one of these, or has one of these files, has configured Fast DDS.
_DECISIONS = (*_FILES, _FROM_XML, 'RMW_FASTRTPS_PUBLICATION_MODE')
_LOCAL_FILES = ('DEFAULT_FASTDDS_PROFILES.xml', 'DEFAULT_FASTRTPS_PROFILES.xml')


def bound_memory(
    environment: MutableMapping[str, str] = os.environ, folder: Path = Path()
) -> bool:
    """Let Fast DDS load `PROFILES` in this process, by its environment variables.

    By default every slot of every queue keeps the memory of the largest message it has held, so
    the memory of some hundred large messages is never freed.

    Returns:
        False where the user has configured Fast DDS, whose settings then stay.
    """
    if any(name in environment for name in _DECISIONS):
        return False
    if any((folder / name).exists() for name in _LOCAL_FILES):
        return False
    environment.update(dict.fromkeys(_FILES, str(PROFILES)))
    environment[_FROM_XML] = '1'
    return True
