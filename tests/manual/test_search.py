"""The frame that stands for a worker where the manual is opened from the file system."""

import shutil

import pytest
from browser import chromium, opened
from small import ROOT

pytestmark = pytest.mark.skipif(chromium() is None, reason="needs chromium on the PATH")

PAGE = """<!doctype html><title>manual</title><script src="iframe-worker.js"></script><body><script>
const worker = new Worker("worker.js");
window.answer = new Promise((resolve) => worker.addEventListener("message", (event) => resolve(event.data)));
worker.postMessage([3, 4]);
</script>"""
WORKER = "addEventListener('message', (event) => postMessage(event.data.map((value) => 2 * value)));"


def test_a_worker_answers_from_the_file_system(tmp_path):
    shutil.copy(ROOT / "docs" / "iframe-worker.js", tmp_path)
    (tmp_path / "worker.js").write_text(WORKER)
    (tmp_path / "index.html").write_text(PAGE)
    with opened(tmp_path / "browser") as page:
        page.open(tmp_path / "index.html")
        assert page.evaluate("window.answer") == [6, 8]
        assert page.complaints() == []
