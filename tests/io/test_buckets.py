"""Stores in a bucket of S3, behind a server on loopback."""

import sys

import pytest

from dicflow.errors import ConfigurationError, StoreError
from dicflow.io.buckets import open_bucket
from tests.io.s3_server import PAGE, serving


@pytest.fixture
def objects(monkeypatch):
    """The objects of the bucket ``laboratory``."""
    with serving("laboratory") as (address, objects):
        for name, value in {"ENDPOINT_URL": address, "ALLOW_HTTP": "true", "REGION": "us-east-1"}.items():
            monkeypatch.setenv(f"AWS_{name}", value)
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "name")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        yield objects


def test_objects_lie_below_the_folder_of_the_url(objects):
    bucket = open_bucket("s3://laboratory/strip/2026/")
    bucket.put("runs/a.json", b"one")
    assert objects == {"strip/2026/runs/a.json": b"one"}
    assert bucket.get("runs/a.json", 3) == b"one"
    assert bucket.name == "s3://laboratory/strip/2026"
    with pytest.raises(FileNotFoundError):
        bucket.get("runs/b.json", 10)
    with pytest.raises(StoreError, match=r"s3://laboratory/strip/2026/runs/a.json: has more than 2 bytes"):
        bucket.get("runs/a.json", 2)


def test_lists_have_all_pages(objects):
    bucket = open_bucket("s3://laboratory")
    for number in range(2 * PAGE + 1):
        bucket.put(f"objects/{number:02d}", bytes(number))
    bucket.put("other/00", b"")
    assert bucket.sizes("objects") == {f"objects/{number:02d}": number for number in range(2 * PAGE + 1)}
    assert bucket.sizes("actions") == {}


@pytest.mark.usefixtures("objects")
def test_a_bucket_that_does_not_exist_is_one_sentence():
    bucket = open_bucket("s3://elsewhere/strip")
    for ask in (lambda: bucket.sizes("objects"), lambda: bucket.put("a", b"")):
        with pytest.raises(StoreError) as caught:
            ask()
        assert str(caught.value).startswith("s3://elsewhere/strip")
        assert "\n" not in str(caught.value)
        assert "<" not in str(caught.value)


@pytest.mark.parametrize(
    "url", ["s3://", "s3://UPPER/x", "s3://a", "http://a.b/c", "file:///etc", "s3://name:key@host/x", "s3://lab/../x"]
)
def test_other_urls_are_refused(url):
    with pytest.raises(ConfigurationError, match="expected s3://BUCKET or s3://BUCKET/FOLDER"):
        open_bucket(url)


def test_a_missing_library_is_named_with_its_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "obstore.store", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'dicflow\[bucket\]'"):
        open_bucket("s3://laboratory")
