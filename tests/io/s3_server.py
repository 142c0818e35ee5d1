"""A server on loopback that speaks as much of S3 as stores need: objects, and lists in pages."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.parse import parse_qs, unquote, urlsplit
from xml.sax.saxutils import escape

__all__ = ["PAGE", "serving"]

PAGE = 7
"""Objects on a page of a list."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    objects: dict[str, bytes]
    bucket: str

    def do_PUT(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"]))
        if self._known():
            self.objects[self._key()] = content
            self._answer(200, b"", content)

    def do_GET(self) -> None:
        if not self._known():
            return
        query = parse_qs(urlsplit(self.path).query)
        if "list-type" in query:
            self._answer(200, self._listed(query["prefix"][0], query.get("continuation-token", [""])[0]).encode())
        elif self._key() in self.objects:
            self._answer(200, self.objects[self._key()], self.objects[self._key()])
        else:
            self._answer(404, b"<Error><Code>NoSuchKey</Code></Error>")

    def _known(self) -> bool:
        """Whether the bucket exists and the request is signed; answers if not."""
        signed = "AWS4-HMAC-SHA256" in self.headers.get("Authorization", "")
        exists = urlsplit(self.path).path.split("/")[1] == self.bucket
        if not signed or not exists:
            code = "NoSuchBucket" if signed else "AccessDenied"
            self._answer(404 if signed else 403, f"<Error><Code>{code}</Code></Error>".encode())
        return signed and exists

    def _key(self) -> str:
        return unquote(urlsplit(self.path).path).split("/", 2)[2]

    def _listed(self, prefix: str, after: str) -> str:
        found = [key for key in sorted(self.objects) if key.startswith(prefix) and key > after]
        rows = "".join(
            f"<Contents><Key>{escape(key)}</Key><Size>{len(self.objects[key])}</Size>"
            "<LastModified>2026-01-31T10:15:00.000Z</LastModified></Contents>"
            for key in found[:PAGE]
        )
        more = len(found) > PAGE
        token = f"<NextContinuationToken>{escape(found[PAGE - 1])}</NextContinuationToken>" if more else ""
        cut = f"<IsTruncated>{str(more).lower()}</IsTruncated>"
        return f"<ListBucketResult>{cut}{token}{rows}</ListBucketResult>"

    def _answer(self, code: int, body: bytes, content: bytes = b"") -> None:
        self.send_response(code)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("ETag", f'"{hashlib.md5(content).hexdigest()}"')
        self.send_header("Last-Modified", formatdate(usegmt=True))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@contextmanager
def serving(bucket: str) -> Iterator[tuple[str, dict[str, bytes]]]:
    """Address of a server with one bucket, and the bucket's objects by name."""
    objects: dict[str, bytes] = {}
    handler = type("Handler", (_Handler,), {"objects": objects, "bucket": bucket})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    thread = Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", objects
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
