"""Types of messages: those of ROS 2 Jazzy, and ours from the definitions of the ROS package."""

import functools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from octo_arm_model.arm.errors import BagError

PACKAGE = 'octo_arm_msgs'
STRING = 'std_msgs/msg/String'
_LONGEST = 2**20  # entries in an array of fixed length
_MOST_FIELDS, _DEEPEST = 40, 5  # bounds of the fields of a type that are listed
_NOT_NUMBERS = ('string', 'wstring', 'bool', 'octet')
_NO_TENSIONS = ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time')
_IDL_RULE = '=' * 80 + '\n'  # between the files of one IDL definition


@functools.cache
def known_types() -> Typestore:
    """Return the types that can be written, and that are read if a bag does not define them.

    Raises:
        BagError: if our definitions are not installed.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    # The definitions are in a checkout or installed.
    for parent in Path(__file__).resolve().parents:
        for folder in (parent / 'msg_defs' / 'msg', parent / 'share' / 'octo_arm_model' / 'msg'):
            for path in (paths := sorted(folder.glob('*.msg'))):
                name = f'{PACKAGE}/msg/{path.stem}'
                store.register(get_types_from_msg(path.read_text(encoding='utf-8'), name))
            if paths:
                return store
    raise BagError(f'the definitions of {PACKAGE} are not installed')


def types_for(type_name: str, definitions: Iterable[MessageDefinition]) -> Typestore:
    """Return types that decode messages of one type: by the first definition, or the known ones.

    Each type has its own store, so that the definitions of several types cannot conflict.

    Raises:
        BagError: if the type is neither defined nor known, or its definition is invalid.
    """
    defined = [d for d in definitions if d.format != MessageDefinitionFormat.NONE]
    if not defined:
        if type_name not in known_types().fielddefs:
            raise BagError(f'nothing defines the type {type_name}, and it is not known here')
        return known_types()
    store = get_typestore(Stores.EMPTY)
    text = defined[0].data
    try:
        if defined[0].format == MessageDefinitionFormat.MSG:
            store.register(_bounded(get_types_from_msg(text, type_name)))
        else:
            for part in filter(None, text.split(_IDL_RULE)):
                # A part may begin with a line that names its type.
                idl = part.split('\n', 1)[1] if part.startswith('IDL: ') else part
                store.register(_bounded(get_types_from_idl(idl)))
        store.get_msgdef(type_name)
    except BagError:
        raise
    except Exception as error:
        # Parsers raise errors of several types for an invalid definition.
        raise BagError(f'the definition of {type_name} is invalid') from error
    return store


def _bounded(types: Typesdict) -> Typesdict:
    """Return the ``types``; raise BagError if a fixed array is too long, which rosbags unrolls."""
    for name, (_, fields) in types.items():
        for field, (kind, content) in fields:
            length = content[1] if kind == Nodetype.ARRAY else 0
            if isinstance(length, int) and length > _LONGEST:
                raise BagError(f'{name} has {length} of {field}, at most {_LONGEST} are read')
    return types


def numeric_fields(types: Typestore, type_name: str) -> list[str]:
    """Return paths of the numeric fields and arrays of a type, at most a fixed number."""
    paths: list[str] = []

    def walk(name: str, prefix: str, depth: int) -> None:
        described: Any
        for field, described in types.get_msgdef(name).fields:
            kind, content = described
            is_array = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
            inner_kind, inner = content[0] if is_array else (kind, content)
            if len(paths) >= _MOST_FIELDS:
                return
            if inner_kind == Nodetype.BASE and inner[0] not in _NOT_NUMBERS:
                paths.append(prefix + field)
            elif inner_kind == Nodetype.NAME and not is_array and depth < _DEEPEST:
                if inner not in _NO_TENSIONS:
                    walk(str(inner), f'{prefix}{field}.', depth + 1)

    walk(type_name, '', 0)
    return paths
