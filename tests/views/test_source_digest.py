"""The digest of the code that draws: the same for the same files, another one for any that changed."""

from dicflow.views import source_digest as module


def test_it_changes_with_every_file_of_its_layers_alone(tmp_path, monkeypatch):
    digest = module.source_digest.__wrapped__
    for layer in ("views", "report", "core"):
        (tmp_path / layer).mkdir()
        (tmp_path / layer / "a.py").write_text("1")
    monkeypatch.setattr(module, "__file__", str(tmp_path / "views" / "source_digest.py"))
    before = digest("views", "report")
    (tmp_path / "core" / "a.py").write_text("2")
    (tmp_path / "views" / "a.pyc").write_text("compiled")
    assert digest("views", "report") == before
    (tmp_path / "report" / "page.html").write_text("a template")
    changed = digest("views", "report")
    (tmp_path / "views" / "a.py").write_text("2")
    assert len({before, changed, digest("views", "report"), digest("views")}) == 4
