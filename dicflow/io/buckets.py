"""Stores in a bucket that speaks S3, with obstore; keys and region come from the environment, as for other programs."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from datetime import timedelta
from typing import Any, TypeVar

from dicflow.engine.transfer import Target
from dicflow.errors import ConfigurationError, StoreError

__all__ = ["Bucket", "is_url", "open_bucket"]

T = TypeVar("T")
_URL = re.compile(r"s3://[a-z0-9][a-z0-9.-]{1,61}[a-z0-9](/(?!\.)[\w.=+-]+)*/?")
_RETRIES = {"max_retries": 3, "retry_timeout": timedelta(seconds=30)}


def is_url(text: str) -> bool:
    """Whether a text names something else than a folder.

    >>> is_url("s3://tests/strip"), is_url("C:/stores/strip")
    (True, False)
    """
    return "://" in text


def open_bucket(url: str) -> Target:
    """The bucket of a URL such as ``s3://bucket/folder``. Nothing is asked of it yet.

    Raises ConfigurationError for another URL, and where obstore is not installed.
    """
    if not _URL.fullmatch(url):
        raise ConfigurationError(f"{url}: expected s3://BUCKET or s3://BUCKET/FOLDER, or the path of a folder")
    try:
        from obstore.store import from_url
    except ImportError as error:
        raise ConfigurationError("a bucket needs obstore: pip install 'dicflow[bucket]'") from error
    return Bucket(url.rstrip("/"), from_url(url, retry_config=_RETRIES))


class Bucket:
    """A store in a bucket. store : of obstore"""

    def __init__(self, name: str, store: Any) -> None:
        self.name, self._store = name, store

    def get(self, path: str, most: int) -> bytes:
        """Contents of an object. Raises FileNotFoundError; StoreError for one that cannot be read or is too large."""
        return self._asked(path, lambda: self._contents(path, most))

    def put(self, path: str, content: bytes) -> None:
        """Write an object. Raises StoreError."""
        try:
            self._asked(path, lambda: self._store.put(path, content))
        except FileNotFoundError as error:
            raise StoreError(self.name, "does not exist", "make the bucket first, or correct its name") from error

    def sizes(self, folder: str) -> Mapping[str, int]:
        """Size [bytes] of every object below a folder, by path. Raises StoreError."""
        pages = self._asked(folder, lambda: list(self._store.list(folder)))
        return {entry["path"]: entry["size"] for page in pages for entry in page}

    def _contents(self, path: str, most: int) -> bytes:
        found = self._store.get(path)
        if found.meta["size"] > most:
            raise StoreError(f"{self.name}/{path}", f"has more than {most} bytes", "push the run again")
        return bytes(found.bytes())

    def _asked(self, path: str, ask: Callable[[], T]) -> T:
        from obstore.exceptions import BaseError

        try:
            return ask()
        except BaseError as error:
            remedy = "check the name, the network, and the keys in AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
            raise StoreError(f"{self.name}/{path}", f"cannot be reached ({_reason(error)})", remedy) from error


def _reason(error: Exception) -> str:
    """What obstore says, without the server's markup and its own structures."""
    return " ".join(str(error).partition("\n")[0].partition(": <")[0].split())[:300]
