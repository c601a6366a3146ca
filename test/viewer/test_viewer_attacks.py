"""The viewer against pages that mean harm: real connections to the real thing."""

import contextlib
import http.client
import itertools
import math
import socket
import time

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from live_nodes import CONFIG, DEADLINE
from octo_arm_msgs.msg import TendonTensions
from viewer_setup import Setup
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from octo_arm_model.ros.topics import decoded, take_all
from octo_arm_model.simulation.movements import tendon_limits

LIMITS = tendon_limits(CONFIG)
NAMES = CONFIG.arm.tendon_names
EVIL = 'http://evil.example'
NAN, INF = math.nan, math.inf
CAMERA = {
    'type': 'ViewerCameraMessage',
    'wxyz': [1.0, 0.0, 0.0, 0.0],
    'position': [1.0, 1.0, 1.0],
    'fov': 0.7,
    'near': 0.01,
    'far': 100,
    'image_height': 600,
    'image_width': 800,
    'look_at': [0, 0, 0],
    'up_direction': [0, 0, 1],
}
DRAG = {
    'type': 'TransformControlsUpdateMessage',
    'name': '/target',
    'wxyz': [1.0, 0.0, 0.0, 0.0],
    'position': [0.3, 0.1, 0.0],
    'owner': '',
}


class Page:
    """What a page does, without a browser that keeps it from worse."""

    def __init__(self, port, host='localhost', origin=None, protocol=None):
        self._socket = connect(
            f'ws://{host}:{port}',
            sock=socket.create_connection(('127.0.0.1', port)),
            origin=origin,
            subprotocols=[protocol or f'viser-v{viser.__version__}'],
            max_size=None,
            compression=None,
            max_queue=None,
            open_timeout=DEADLINE,
        )
        self.controls = {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()

    def read(self):
        """Take all that is shown at first."""
        self.send(CAMERA)
        while True:
            data = self._socket.recv(timeout=DEADLINE)
            size = int.from_bytes(data[8:16], 'little')
            text = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
            for message in msgspec.msgpack.decode(text)['messages']:
                if 'label' in (message.get('props') or {}):
                    self.controls[message['props']['label']] = message['uuid']
                if message['type'] == 'ReplayDoneMessage':
                    return self

    def send(self, message):
        raw = message if isinstance(message, (bytes, str)) else msgspec.msgpack.encode(message)
        self._socket.send(raw)

    def update(self, label, **updates):
        uuid = self.controls[label]
        self.send({'type': 'GuiUpdateMessage', 'uuid': uuid, 'updates': updates})

    def wait_for(self, text):
        while text not in zstandard.ZstdDecompressor().decompress(
            self._socket.recv(DEADLINE)[16:]
        ):
            pass

    def wait_until_closed(self):
        end = time.monotonic() + DEADLINE
        with pytest.raises(ConnectionClosed):
            while time.monotonic() < end:
                self._socket.recv(timeout=DEADLINE)


class Attacked(Setup):
    """The viewer, and all that it ever commands."""

    def __init__(self):
        super().__init__()
        self.number = int(self.url.rpartition(':')[2])
        self.commands, self.last, self.tension = [], np.zeros(len(NAMES)), 0.0
        self._topic = self.client._node.create_subscription(
            TendonTensions, 'tendon_commands', lambda _: None, 1000, raw=True
        )
        self.wait_for(lambda: self.client.tensions is not None, 'the first tensions')
        end = time.monotonic() + DEADLINE
        while time.monotonic() < end:
            with Page(self.number) as page:
                self.labels = page.read().controls
            if 'Speed' in self.labels:
                return
        raise AssertionError('no page')

    def page(self, **options):
        return Page(self.number, **options).read()

    def hear(self):
        messages = [
            decoded(data, TendonTensions) for data, _ in take_all(self._topic, TendonTensions)
        ]
        new = [np.array(message.tension) for message in messages]
        self.commands += new
        self.last = new[-1] if new else self.last
        return self.commands

    def still_obeys(self):
        """A page that means well is obeyed, and nothing but that was commanded since the last."""
        with self.page() as page:
            while not self.pulls_one(page):
                pass  # something was under way, which the pull stopped
        for command in self.commands:
            assert np.isfinite(command).all()
            assert (command >= 0.0).all()
            assert (command <= LIMITS * (1.0 + 1e-9)).all()
        others = [command for command in self.commands if np.delete(command, 5).any()]
        self.commands.clear()
        assert self.viewer.poll() is None
        return others

    def pulls_one(self, page):
        """Slacken all but one tendon; whether the others were slack by then."""
        page.update('Let all go slack', value=True)
        self.wait_for(lambda: self.hear() is not None and not self.last.any(), 'slack')
        self.tension = round(self.tension % 3.0 + 0.01, 2)
        self.pull(page, 5, self.tension)
        return np.count_nonzero(self.last) == 1

    def pull(self, page, tendon, tension):
        """Set a slider of ``page`` until its tension is commanded."""
        page.update(NAMES[tendon], value=tension)
        what = f'the tension of {NAMES[tendon]}'
        self.wait_for(lambda: self.hear() and self.last[tendon] == tension, what)

    def request(self, path, **headers):
        connection = http.client.HTTPConnection('127.0.0.1', self.number, timeout=DEADLINE)
        connection.putrequest('GET', path, skip_host=True)
        for name, value in {'Host': f'localhost:{self.number}', **headers}.items():
            connection.putheader(name, value)
        connection.endheaders()
        response = connection.getresponse()
        response.read()
        connection.close()
        return response


@pytest.fixture(scope='module')
def viewer():
    viewer = Attacked()
    began = time.monotonic()
    yield viewer
    assert viewer.still_obeys() == []
    took = time.monotonic() - began
    # Says the processes ended in order, without a stack of calls.
    complaints = viewer.close()
    lines = complaints.splitlines()
    assert lines, 'nothing was said of all this'
    assert len(lines) <= took + 5.0
    for line in lines:
        assert line.startswith('viewer refused: '), complaints


# Who may connect --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('host', 'origin'),
    [
        ('localhost', EVIL),
        ('localhost', 'null'),
        ('localhost', 'http://localhost:1'),
        ('localhost', 'http://localhost.evil.example'),
        ('localhost', 'file://'),
        ('127.0.0.1', 'http://localhost:{port}'),
        ('evil.example', f'{EVIL}:{{port}}'),  # its name points here: DNS rebinding
        ('evil.example', None),
        ('localhost.evil.example', None),
    ],
)
def test_a_page_from_elsewhere_is_not_let_in(viewer, host, origin):
    with pytest.raises(InvalidStatus) as refused:
        Page(viewer.number, host=host, origin=origin and origin.format(port=viewer.number))
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize('host', ['localhost', '127.0.0.1', '[::1]', 'LOCALHOST'])
def test_the_page_itself_is_let_in_but_none_of_another_version(viewer, host):
    origin = f'http://{host.lower()}:{viewer.number}'
    with Page(viewer.number, host=host, origin=origin) as page:
        assert page.read().controls.keys() >= {'Speed', *NAMES}
    with pytest.raises(InvalidStatus):
        Page(viewer.number, host=host, origin=origin, protocol='viser-v0.0.1')


def test_the_page_alone_is_served_under_its_own_names_and_connects_nowhere_else(viewer):
    response = viewer.request('/')
    assert response.status == 200
    policy = response.headers['Content-Security-Policy']
    assert f"connect-src 'self' ws://localhost:{viewer.number} " in policy
    assert "frame-ancestors 'none'" in policy
    for host in ('evil.example', 'localhost.evil.example', 'localhost@evil', ''):
        assert viewer.request('/', Host=host).status == 403
    passwd = '/../../etc/passwd', '/%2e%2e/%2e%2e/etc/passwd', '//etc'
    for path in ('/' + 5000 * 'a', '/%00', *passwd):
        assert viewer.request(path).status == 404


def test_what_is_no_request_and_connections_that_say_nothing_are_survived(viewer):
    starts = b'\x16\x03\x01\x02\x00', b'GET\r\n\r\n', b'POST / HTTP/1.1\r\n\r\n'
    for data in (*starts, 70000 * b'x'):
        with socket.create_connection(('127.0.0.1', viewer.number), timeout=DEADLINE) as raw:
            with contextlib.suppress(ConnectionError):  # may end before all is sent
                raw.sendall(data)
    silent = [socket.create_connection(('127.0.0.1', viewer.number)) for _ in range(300)]
    for connection in silent[200:]:  # let go at once
        connection.settimeout(DEADLINE)
        assert connection.recv(1) == b''
    for connection in silent:
        connection.close()
    assert viewer.still_obeys() == []


def test_many_pages_are_as_many_as_can_be_served(viewer):
    pages = []
    with pytest.raises(InvalidStatus) as refused:
        for _ in range(100):
            pages.append(Page(viewer.number))
    assert refused.value.response.status_code == 503
    assert 8 <= len(pages) < 100
    for page in pages:
        with page:
            pass
    assert viewer.still_obeys() == []


# What may be asked ------------------------------------------------------------------------------

LABELS = 'Speed', NAMES[4], 'Movement', 'Let all go slack', 'Loop'
MORE = (
    {'update_cb': []},
    {'sync_cb': None},
    {'removed': True},
    {'is_button': True},
    {'nothing_of_that_name': 1},
    {'value': 1.0, 'update_cb': []},
    {},
)
SPEEDS = 0, 0.05, -1.0, NAN, INF, 1e300, 'x'
PROFILES = '/etc/passwd', '/etc/passwd.csv', '../x.yaml', '', 1, None
TENSIONS = 1e6, 4.1, -5, -1e-3, NAN, INF, -INF, True, None, 'x', [], {}, 2**63
UPDATES = {  # labels of controls, and what is set of each
    'no tension beyond its limits': [(NAMES[4], {'value': value}) for value in TENSIONS],
    'a flood, answered by a line a second': 500 * [(NAMES[4], {'value': 1e6})],
    'no speed but those of the slider': [('Speed', {'value': value}) for value in SPEEDS],
    'no profile that is not listed': [('Movement', {'value': name}) for name in PROFILES],
    'nothing but the value of a control': [*itertools.product(LABELS, MORE)],
}


@pytest.mark.parametrize('updates', UPDATES.values(), ids=UPDATES)
def test_controls_are_set_within_their_bounds_alone(viewer, updates):
    with viewer.page() as page:
        for label, update in updates:
            page.update(label, **update)
        assert viewer.still_obeys() == []
        # The controls do what they did.
        page.update('Play', value=True)
        viewer.wait_for(lambda: any(c[4:].any() for c in viewer.hear()), 'the profile')
        for label, update in updates if updates[0][0] == 'Speed' else ():
            page.update(label, **update)
    viewer.still_obeys()


DRAGS = (
    *({'position': at} for at in ([NAN, 0, 0], [INF, 0, 0], [1e300, 0, 0], [0, 0], 'x')),
    {'wxyz': [NAN, 0.0, 0.0, 0.0]},
    *({'name': name} for name in ('/arm', '/nothing')),
    {'owner': 'x'},
    {'more': 1},
)
CAMERAS = (
    {'fov': NAN},
    {'position': [NAN, 0.0, 0.0]},
    {'look_at': [1e300, 0.0, 0.0]},
    {'wxyz': [1.0]},
    *({'image_width': size} for size in (10**9, 0, -1, True)),
    {'wxyz': 4 * [0.0], 'image_height': 0},
    {'more': 1},
)
TYPES = 'ShareUrlRequest', 'GuiFormDirtyMessage', 'GuiFormSubmitMessage', 'CommandTriggerMessage'
UPLOAD = {'source_component_uuid': 'SLIDER', 'transfer_uuid': 'a', 'filename': '/etc/x'}
PART = {'source_component_uuid': 'SLIDER', 'transfer_uuid': 'a', 'part_index': 0}
MESSAGES = [
    *({**DRAG, **change} for change in DRAGS),
    *({**CAMERA, **change} for change in CAMERAS),
    *({'type': kind, 'uuid': 'a'} for kind in TYPES),
    {'type': 'ShareUrlRequest'},
    {'type': 'RunJavascriptMessage', 'source': 'alert(1)'},
    {
        **UPLOAD,
        'type': 'FileTransferStartUpload',
        'mime_type': 'x',
        'part_count': 0,
        'size_bytes': 0,
    },
    {**PART, 'type': 'FileTransferPart', 'content': 1000 * b'x'},
    {'type': 'NoSuchMessage'},
    {'type': 5},
    {},
    [],
    5,
    b'',
    b'\xc1',
    30_000 * b'\x91',
    b'\xdf\xff\xff\xff\xff',
    'text',
]


def test_what_no_page_here_asks_for_is_passed_over(viewer):
    with viewer.page() as page:
        for message in MESSAGES:
            if isinstance(message, dict) and 'SLIDER' in message.values():
                message = {**message, 'source_component_uuid': page.controls[NAMES[0]]}
            page.send(message)
        # It is still there, and nobody else heard of it.
        page.update(NAMES[4], value=0.0)
        assert viewer.still_obeys() == []
        viewer.pull(page, 4, 1.5)
    viewer.still_obeys()


def test_a_search_for_a_target_does_not_replace_a_newer_command(viewer):
    with viewer.page() as page:
        page.send({**DRAG, 'position': [-5.0, 0.0, 0.0]})  # out of reach, which takes long
        page.wait_for(b'searching')
        page.update('Let all go slack', value=True)
        page.wait_for(b'A newer command')
        assert viewer.still_obeys() == []


def test_a_message_of_any_size_is_not_taken_in(viewer):
    with viewer.page() as page:
        with contextlib.suppress(ConnectionClosed):
            page.send((2**16 + 1) * b'x')
        page.wait_until_closed()
    assert viewer.still_obeys() == []
