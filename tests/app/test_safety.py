"""Strangers are refused: other pages, other hosts, no token, paths outside, names that are HTML."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest
from app_serving import FILE, served, small_test

from dicflow.app.project import open_project
from dicflow.app.safety import HEADERS, Gate, Refused, inside
from dicflow.errors import ConfigurationError, InputError

EVERYTHING = [
    ("GET", "/"),
    ("GET", "/static/main.js"),
    ("POST", "/ask/project"),
    ("GET", "/picture/thumbnail"),
    ("GET", "/x"),
]


@pytest.fixture
def app(tmp_path):
    small_test(tmp_path / "test")
    with served(tmp_path / "test") as running:
        yield running


def test_gate_knows_host_origin_and_token():
    gate = Gate(8000, "abc")
    gate.check("127.0.0.1:8000", None, "abc")
    gate.check("localhost:8000", "http://127.0.0.1:8000", "abc")
    for host, origin, token in [
        ("127.0.0.1:8001", None, "abc"),
        ("evil.example:8000", None, "abc"),
        ("127.0.0.1:8000", "http://evil.example", "abc"),
        ("127.0.0.1:8000", "http://127.0.0.1:9000", "abc"),
        ("127.0.0.1:8000", "null", "abc"),
        ("127.0.0.1:8000", None, ""),
        ("127.0.0.1:8000", None, "abcd"),
        ("127.0.0.1:8000", None, "äbc"),
    ]:
        with pytest.raises(Refused, match="open the link"):
            gate.check(host, origin, token)


@pytest.mark.parametrize(("method", "path"), EVERYTHING)
def test_without_the_token_nothing_is_answered(app, method, path):
    host = f"127.0.0.1:{app.gate.port}"
    for cookie in ({}, {"Cookie": f"{app.gate.cookie}=guess"}):
        answer = app.request(method, path, {}, Host=host, Content_Type="application/json", **cookie)
        assert answer.status == 403
        assert "token" in answer.json["message"]


@pytest.mark.parametrize(("method", "path"), EVERYTHING)
@pytest.mark.parametrize("stranger", [{"Host": "evil.example"}, {"Origin": "http://evil.example"}, {"Origin": "null"}])
def test_another_host_or_origin_is_refused_even_with_the_token(app, method, path, stranger):
    answer = app.own(method, path, {}, **stranger)
    assert answer.status == 403
    assert answer.json["message"].endswith("open the link that 'dicflow app' printed")


def test_link_lets_the_browser_in_and_scripts_come_from_the_app_alone(app):
    host = f"127.0.0.1:{app.gate.port}"
    answer = app.request("GET", f"/?token={app.gate.token}", Host=host)
    assert answer.status == 200
    cookie = answer.headers["set-cookie"]
    assert {"HttpOnly", "SameSite=Strict"} <= set(cookie.split("; "))
    policy = answer.headers["content-security-policy"]
    assert policy == HEADERS["Content-Security-Policy"]
    assert "'unsafe-inline'" not in policy
    page = answer.body.decode()
    assert not re.search(r"<script(?![^>]*src=)|<style|\son\w+=|javascript:", page)


def test_every_answer_has_the_headers(app):
    for answer in (app.own("GET", "/static/app.css"), app.ask("project"), app.own("GET", "/no"), app.own("PUT", "/")):
        assert {name.lower(): value for name, value in HEADERS.items()}.items() <= answer.headers.items()


def test_questions_are_json_and_known(app):
    assert app.own("POST", "/ask/project", {}, **{"Content-Type": "text/plain"}).status == 415
    assert app.ask("rm").status == 404
    assert app.ask("document").status == 400


@pytest.mark.parametrize("name", ["../secret.yaml", "/etc/passwd", "link.yaml", "folder/secret.yaml", "\0"])
def test_files_outside_the_folder_are_refused_also_through_links(app, tmp_path, name):
    (tmp_path / "secret.yaml").write_text("stages: {secret: 1}")
    (tmp_path / "test" / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    (tmp_path / "test" / "folder").symlink_to(tmp_path)
    for answer in (
        app.ask("document", file=name),
        app.ask("edit", file=name, digest="", edits=[{"place": ["title"], "value": "x"}], words="x"),
        app.own("GET", f"/picture/thumbnail?path={name.replace(chr(0), '%00')}"),
        app.ask("photograph", file=name),
    ):
        assert answer.status == 422, answer.body
        assert b"secret: 1" not in answer.body
    assert (tmp_path / "secret.yaml").read_text() == "stages: {secret: 1}"


def test_photographs_and_regions_outside_are_refused(app, tmp_path):
    small_test(tmp_path / "other")
    path = tmp_path / "test" / FILE
    path.write_text(path.read_text().replace("left/*.png", "../other/left/*.png"))
    assert app.ask("photograph", file=FILE).status == 422
    path.write_text(path.read_text().replace("rectangle: [20, 20, 180, 130]", "file: ../other/r.geojson"))
    (tmp_path / "other" / "r.geojson").write_text('{"type": "Polygon", "coordinates": [[[0,0],[1,0],[1,1]]]}')
    assert app.ask("drawing", file=FILE).status == 422


def test_pictures_are_known_by_their_names_alone(app):
    for name in ("../history.json", "thumbnails/../../x.jpg", "..%2f..%2fpipeline.yaml", f"{'a' * 32}/info.txt"):
        assert app.own("GET", f"/picture/{name}").status in (404, 422)


def test_only_pipeline_files_are_written_as_text(app, tmp_path):
    before = (tmp_path / "test/left/step_0000.png").read_bytes()
    digest = hashlib.sha256(before).hexdigest()
    assert app.ask("rewrite", file="left/step_0000.png", digest=digest, text="x").status == 422
    assert app.ask("rewrite", file="../x.yaml", digest="", text="x").status == 422
    assert (tmp_path / "test/left/step_0000.png").read_bytes() == before
    assert not (tmp_path / "x.yaml").exists()


def test_inside_follows_links(tmp_path):
    root = tmp_path / "root"
    root.mkdir()
    (root / "out").symlink_to(tmp_path)
    (root / "loop").symlink_to(root / "loop")
    assert inside([root], root / "a" / ".." / "b") == root / "b"
    for path in (root / "..", root / "out" / "x", root / "loop", Path(f"{root}-more")):
        with pytest.raises(InputError):
            inside([root], path)


def test_projects_are_folders_or_files(tmp_path):
    path = small_test(tmp_path / "test")
    assert open_project(path).chosen == FILE
    assert open_project(tmp_path / "test").pipelines() == [FILE]
    with pytest.raises(InputError, match="no such folder or file"):
        open_project(tmp_path / "none")
    with pytest.raises(ConfigurationError, match="--data"):
        open_project(path, tmp_path / "none")
