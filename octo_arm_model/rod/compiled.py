"""How numba compiles the node functions: `compiled`, and the `helper` functions of each file.

Compiling takes about 5 ms for every read or written element and 20 ms for every loop, and each
again where it is inlined. So what is called from compiled functions alone has no entry from
Python, and no array is assigned to another as a whole, for which numba compiles messages.
"""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

_F = TypeVar('_F', bound=Callable[..., object])
# What machine code is made of; of these files numba watches the one of each function alone.
_SOURCES = '*loops.py', 'section_formulas.py', 'tables.py', 'compiled.py'


def _forget_older(folder: Path) -> None:
    """Remove what numba keeps of this ``folder`` and is older than a file it was made of."""
    newest = max(file.stat().st_mtime for name in _SOURCES for file in folder.glob(name))
    places = [folder / '__pycache__']
    # Users who may not write into an installed package have it in their own cache.
    user = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    for chosen in (Path(user) / 'numba', os.environ.get('NUMBA_CACHE_DIR')):
        places += Path(chosen).glob(f'{folder.name}_*') if chosen else ()
    for place in places:
        for index in place.glob('*.nbi'):
            with contextlib.suppress(OSError):
                if index.stat().st_mtime < newest:
                    index.unlink()


_forget_older(Path(__file__).parent)


def compiled(function: _F, *, has_entry: bool = True, inlined: bool = False) -> _F:
    """A node function, whose machine code numba keeps."""
    options: dict[str, Any] = {'no_cpython_wrapper': not has_entry, 'no_cfunc_wrapper': True}
    fast = {'contract', 'nsz'}
    compiler = njit(
        cache=has_entry, error_model='numpy', fastmath=fast, forceinline=inlined, **options
    )
    return cast(_F, compiler(function))


def helper(function: _F) -> _F:
    """What node functions call; of files numba's cache watches theirs alone."""
    return compiled(function, has_entry=False)


def inlined(function: _F) -> _F:
    """A `helper` that is copied to where it is called."""
    return compiled(function, has_entry=False, inlined=True)
