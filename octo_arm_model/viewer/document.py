"""The document that a browser loads: that of viser with a title and a layout of its own.

viser has no call for either.
"""

from __future__ import annotations

import gzip
import html

from websockets.http11 import Response

_TITLE = b'<title>Viser</title>'
_HEAD_END = b'</head>'
# On a narrow screen viser lays its panel over the scene. The scene gets what the panel leaves
# free, half of the height or more; the panel its whole width. The limit is that of viser.
_LAYOUT = """
@media (max-width: 36em) {
  div:has(> div canvas):has(> .mantine-Paper-root) { flex-direction: column; }
  div:has(> div canvas):has(> .mantine-Paper-root) > div:has(canvas) {
    height: auto !important; min-height: 0;
  }
  div:has(> div canvas) > .mantine-Paper-root {
    position: static !important; flex: none; width: 100% !important;
    max-height: 50vh !important; max-height: 50dvh !important;
  }
  div:has(> div canvas) > .mantine-Paper-root [style*="width: 20em"] { width: 100% !important; }
}
"""


class Document:
    """Changes the document of viser as it is served."""

    def __init__(self, title: str) -> None:
        """Show ``title`` on the browser's tab."""
        self._title = f'<title>{html.escape(title)}</title>'.encode()
        self._served: dict[bytes, bytes] = {}  # by what viser serves: plain and compressed

    def change(self, response: Response) -> None:
        """Set title and layout in ``response``, if it is the document."""
        headers = response.headers
        if not headers.get('Content-Type', '').startswith('text/html') or not response.body:
            return
        source = bytes(response.body)
        if source not in self._served:
            is_compressed = headers.get('Content-Encoding') == 'gzip'
            text = self._changed(gzip.decompress(source) if is_compressed else source)
            self._served[source] = gzip.compress(text) if is_compressed else text
        response.body = self._served[source]
        del headers['Content-Length']
        headers['Content-Length'] = str(len(response.body))

    def _changed(self, text: bytes) -> bytes:
        layout = f'<style>{_LAYOUT}</style>'.encode()
        text = text.replace(_TITLE, self._title, 1)
        return text.replace(_HEAD_END, layout + _HEAD_END, 1)
