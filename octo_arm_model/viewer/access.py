"""Checks of who may command the arm: headers Host and Origin, and the messages of pages.

A browser sends the origin of the page with every WebSocket that the page opens; other origins are
refused. A page whose name resolves to this machine (DNS rebinding) has the origin of the viewer,
but its own name in Host, which is checked too.

The pages here need five of viser's messages: the camera, the value of a control, and a dragged
point with the start and end of the drag. All others are refused, such as uploads, other attributes
of a control, sharing over the internet and notifications of other pages.
"""

import ipaddress
import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal
from urllib.parse import SplitResult, urlsplit

import msgspec
import viser
from msgspec import Meta

from octo_arm_model.arm.errors import ConfigError, in_short, shown

_DEFAULT_PORTS = {'http': 80, 'https': 443}
_THIS_MACHINE = ('localhost', '127.0.0.1', '::1')


class Access:
    """The allowed hosts and origins of a page served on one host."""

    def __init__(self, host: str, origins: Sequence[str]) -> None:
        """Allow pages on ``host`` and of ``origins``; ConfigError if one of these is no origin."""
        self._origins = {_origin_of(origin) for origin in origins}
        self._names = {*_THIS_MACHINE, host.lower(), *(name for _, name, _ in self._origins)}
        # DNS cannot rebind an address. A loopback host needs no other address.
        is_loopback = _is_address(host) and ipaddress.ip_address(host).is_loopback
        self._takes_addresses = not (is_loopback or host == 'localhost')

    def objection(self, hosts: Sequence[str], origins: Sequence[str]) -> str:
        """Return why a request with these headers Host and Origin is refused; '' if it is not."""
        host = _split(f'//{hosts[0]}') if len(hosts) == 1 else None
        name = host.hostname or '' if host else ''
        is_address = self._takes_addresses and _is_address(name)
        if host is None or not (name in self._names or is_address):
            return f'host {shown(", ".join(hosts))} is not one that this page is served as'
        if not origins:
            return ''  # not from a browser, which always sends an origin
        page = _split(origins[0]) if len(origins) == 1 else None
        if page is None or page.scheme not in _DEFAULT_PORTS or page.path:
            return f'origin {shown(", ".join(origins))} is none'
        default = _DEFAULT_PORTS[page.scheme]
        is_same = (page.hostname, page.port or default) == (host.hostname, host.port or default)
        if is_same or (page.scheme, page.hostname, page.port or default) in self._origins:
            return ''
        return f'origin {shown(", ".join(origins))} is not allowed'


def _origin_of(text: str) -> tuple[str, str, int]:
    """Return scheme, host and port of an origin; ConfigError if ``text`` is not an origin."""
    parts = _split(text)
    if parts is None or parts.scheme not in _DEFAULT_PORTS or parts.path or not parts.hostname:
        raise ConfigError(f'origin is {text!r}, expected one such as http://arm.lab:8080')
    return parts.scheme, parts.hostname, parts.port or _DEFAULT_PORTS[parts.scheme]


def _split(text: str) -> SplitResult | None:
    """Split a URL of scheme, host and port; None if it has further parts or is invalid."""
    try:
        parts = urlsplit(text)
        parts.port  # noqa: B018 - raises if the port is invalid
    except ValueError:
        return None
    has_more = parts.query or parts.fragment or '@' in parts.netloc or not parts.netloc
    return None if has_more or text != text.strip() else parts


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


_ROUNDING = 1e-9  # relative to the range of a slider

# Of the camera and of dragged points, within 1e6 m of the origin; the decoder refuses NaN too.
_Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Vector = tuple[_Coordinate, _Coordinate, _Coordinate]
_Part = Annotated[float, Meta(ge=-1.001, le=1.001)]
_Rotation = tuple[_Part, _Part, _Part, _Part]
_Pixels = Annotated[int, Meta(ge=0, le=100_000)]  # along one side of a window


class _Request(msgspec.Struct, tag_field='type', forbid_unknown_fields=True):
    """A message of a page, encoded in msgpack."""


class _Camera(_Request, tag='ViewerCameraMessage'):
    wxyz: _Rotation
    position: _Vector
    fov: Annotated[float, Meta(gt=0.0, lt=math.pi)]
    near: _Coordinate
    far: _Coordinate
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Vector
    up_direction: _Vector


class _Updates(msgspec.Struct, forbid_unknown_fields=True):
    value: Any  # checked against the control


class _Value(_Request, tag='GuiUpdateMessage'):
    uuid: str
    updates: _Updates


class _DragStart(_Request, tag='TransformControlsDragStartMessage'):
    name: str
    owner: Literal[''] = ''


class _DragEnd(_DragStart, tag='TransformControlsDragEndMessage'):
    pass


class _Drag(_DragStart, tag='TransformControlsUpdateMessage', kw_only=True):
    wxyz: _Rotation
    position: _Vector


_decoder = msgspec.msgpack.Decoder(_Camera | _Value | _Drag | _DragStart | _DragEnd)


def objection_to(data: str | bytes, server: viser.ViserServer | None) -> str:
    """Return why a message from a page is refused; '' if it is not.

    Values and drags are checked against the controls and points of ``server``, once it is there.
    """
    if isinstance(data, str):
        return 'text where a message was expected'
    try:
        request = _decoder.decode(data)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        return f'no request of this page: {in_short(error)}'
    if isinstance(request, _Value):
        control = server and _control(server, request.uuid)
        # The control may have been removed, as for another arm; viser then ignores this.
        return '' if control is None else _value_objection(control, request.updates.value)
    if isinstance(request, _DragStart):
        handle = server and server.scene.get_handle_by_name(request.name)
        if not isinstance(handle, viser.TransformControlsHandle):
            return f'{shown(request.name)} is nothing to be dragged'
    return ''


def _control(server: viser.ViserServer, uuid: str) -> object | None:
    # viser has no public look-up of a control by its uuid, and another thread may remove it.
    guis = [server.gui, *(client.gui for client in server.get_clients().values())]
    controls = (gui._gui_input_handle_from_uuid.get(uuid) for gui in guis)
    return next((control for control in controls if control is not None), None)


def _value_objection(control: Any, value: Any) -> str:
    if isinstance(control, viser.GuiSliderHandle):
        margin = _ROUNDING * (control.max - control.min)
        is_fine = isinstance(value, (int, float)) and not isinstance(value, bool)
        is_fine = is_fine and control.min - margin <= value <= control.max + margin
        expected = f'a number from {control.min} to {control.max}'
    elif isinstance(control, (viser.GuiDropdownHandle, viser.GuiButtonGroupHandle)):
        is_fine = isinstance(value, str) and value in control.options
        expected = f'one of {", ".join(control.options)}'
    elif isinstance(control, viser.GuiCheckboxHandle):
        is_fine, expected = isinstance(value, bool), 'true or false'
    elif isinstance(control, viser.GuiButtonHandle):
        is_fine, expected = value is True, 'true'
    else:
        return f'a value for a {type(control).__name__}, which takes none from a page'
    if is_fine:
        return ''
    return f'{getattr(control, "label", "control")!r} set to {shown(value)}, expected {expected}'
