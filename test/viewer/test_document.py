"""The document that a browser loads."""

import gzip

import pytest

pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')

import urllib.request
from pathlib import Path

import viser
from websockets.datastructures import Headers
from websockets.http11 import Response

from octo_arm_model.viewer.server import Document

PLAIN = b'<html><head><title>Viser</title></head><body><title>Viser</title></body></html>'


def served(document, body, kind='text/html; charset=utf-8', encoding='identity'):
    headers = Headers({'Content-Type': kind, 'Content-Encoding': encoding})
    headers['Content-Length'] = str(len(body))
    response = Response(200, 'OK', headers, body)
    document.change(response)
    assert response.headers.get_all('Content-Length') == [str(len(response.body))]
    return response.body


@pytest.mark.parametrize('encoding', ['identity', 'gzip'])
def test_the_tab_has_the_name_of_the_arm(encoding):
    document = Document('octo_arm: <one> & two')
    body = gzip.compress(PLAIN) if encoding == 'gzip' else PLAIN
    for _ in range(2):
        page = served(document, body, encoding=encoding)
        page = gzip.decompress(page) if encoding == 'gzip' else page
        head = page.partition(b'</head>')[0]
        assert b'<title>octo_arm: &lt;one&gt; &amp; two</title><style>' in head
        assert b'max-width: 36em' in head


def test_what_is_no_page_stays_as_it_is():
    assert served(Document('arm'), PLAIN, 'text/javascript') == PLAIN
    assert served(Document('arm'), b'') == b''


def test_the_installed_page_has_what_is_changed(server):
    page = Path(viser.__file__).parent / 'client' / 'build' / 'index.html'
    source = page.read_bytes()
    assert source.count(b'<title>Viser</title>') == 1
    with urllib.request.urlopen(f'http://127.0.0.1:{server.get_port()}/') as answer:
        page = answer.read()
    assert b'<title>octo_arm</title>' in page
    assert b'Viser</title>' not in page
