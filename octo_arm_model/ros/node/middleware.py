"""What Fast DDS is told before it starts: to give back the memory of messages that are gone."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from pathlib import Path

PROFILES = Path(__file__).with_name('fastdds.xml')
_FILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
_FROM_XML = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
# Who has set one of these, or has a file of this name where the node starts, has decided.
_DECISIONS = (*_FILES, _FROM_XML, 'RMW_FASTRTPS_PUBLICATION_MODE')
_LOCAL_FILES = ('DEFAULT_FASTDDS_PROFILES.xml', 'DEFAULT_FASTRTPS_PROFILES.xml')


def bound_memory(
    environment: MutableMapping[str, str] = os.environ, folder: Path = Path()
) -> bool:
    """Let Fast DDS take `PROFILES` when it starts, in this process.

    By default every place of every queue keeps the memory of the largest message that it has ever
    held, so that some hundreds of large messages of anybody are never given back.

    Returns:
        Whether it will; not where the user has set Fast DDS up.
    """
    if any(name in environment for name in _DECISIONS):
        return False
    if any((folder / name).exists() for name in _LOCAL_FILES):
        return False
    environment.update(dict.fromkeys(_FILES, str(PROFILES)))
    environment[_FROM_XML] = '1'
    return True
