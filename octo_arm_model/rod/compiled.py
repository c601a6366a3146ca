"""The decorators `compiled`, `helper` and `inlined`, by which numba compiles the node functions.

Compiling takes about 5 ms for every element that is read or written and 20 ms for every loop, once
more for every copy that is inlined. So functions that only compiled functions call have no entry
from Python, and no whole array is assigned to another, as numba then compiles error messages too.
"""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

_F = TypeVar('_F', bound=Callable[..., object])
# The files that machine code is made of. Numba itself watches only the file of each function.
_SOURCES = '*loops.py', 'section_formulas.py', 'tables.py', 'compiled.py'


def _forget_older(folder: Path) -> None:
    """Remove the cached machine code of this ``folder`` that is older than one of its sources."""
    newest = max(file.stat().st_mtime for name in _SOURCES for file in folder.glob(name))
    places = [folder / '__pycache__']
    # Users who may not write into an installed package have a cache of their own.
    user = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    for parent in (Path(user) / 'numba', os.environ.get('NUMBA_CACHE_DIR')):
        places += Path(parent).glob(f'{folder.name}_*') if parent else ()
    for place in places:
        for index in place.glob('*.nbi'):
            with contextlib.suppress(OSError):
                if index.stat().st_mtime < newest:
                    index.unlink()


_forget_older(Path(__file__).parent)


def compiled(function: _F, *, has_entry: bool = True, inlined: bool = False) -> _F:
    """Compile a node function, and cache its machine code if it has an entry from Python."""
    options: dict[str, Any] = {'no_cpython_wrapper': not has_entry, 'no_cfunc_wrapper': True}
    # Numba counts references to arrays, which takes half of the time at a node. A function that
    # makes no array does without it.
    options['_nrt'] = has_entry
    fast = {'contract', 'nsz'}
    compiler = njit(
        cache=has_entry, error_model='numpy', fastmath=fast, forceinline=inlined, **options
    )
    return cast(_F, compiler(function))


def helper(function: _F) -> _F:
    """Compile a function that only compiled functions call, and that makes no array."""
    return compiled(function, has_entry=False)


def inlined(function: _F) -> _F:
    """Compile a `helper` that is copied to each of its callers."""
    return compiled(function, has_entry=False, inlined=True)
