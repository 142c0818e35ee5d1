"""Products that are not kept, from one process to another."""

from pathlib import Path

import numpy as np
import pytest
import toys
from test_execute import index
from toys import chain, field, numbers, run_sync

from dicflow.engine import references
from dicflow.engine.handover import Handover, handover_folder
from dicflow.engine.objects import describe, normalised
from dicflow.engine.product import Product, Variable
from dicflow.engine.references import Recipe, Ref, clock, load
from dicflow.engine.store import Store
from tests.replaced import replace_below


@pytest.fixture
def given(tmp_path):
    """What one process gives, and what another one finds."""
    one, other = Handover(limit=400), Handover()
    one.folder = other.folder = tmp_path
    return one, other


def made(values, **attrs):
    product = normalised(field("number", values, **attrs))
    return product, describe(product)


def test_another_process_finds_the_same_product(given):
    several = {
        "file": Variable(("row", "col"), np.arange(6, dtype=np.uint16).reshape(2, 3), "px", "a name of numpy's"),
        "mask": Variable((), np.array(True), "", ""),
    }
    product = normalised(Product("several", several, {"note": "x"}))
    manifest = describe(product)
    given[0].put(product, manifest)
    found = given[1].get(manifest)
    assert describe(found) == manifest
    np.testing.assert_array_equal(found["file"], product["file"])


@pytest.mark.parametrize("damage", [lambda content: b"", lambda content: content[:200], lambda content: b"x" * 900])
def test_a_damaged_file_is_no_product(given, tmp_path, damage):
    product, manifest = made([1.0, 2.0])
    given[0].put(product, manifest)
    (path,) = tmp_path.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    assert given[1].get(manifest) is None


def test_a_file_with_any_byte_damaged_is_no_other_product(given, tmp_path):
    product, manifest = made([1.0, 2.0])
    given[0].put(product, manifest)
    (path,) = tmp_path.iterdir()
    content = path.read_bytes()
    for place, byte in enumerate(content):
        path.write_bytes(content[:place] + bytes([byte ^ 0xFF]) + content[place + 1 :])
        found = given[1].get(manifest)
        assert found is None or describe(found) == manifest


def test_another_product_under_the_name_is_none(given, tmp_path):
    (product, manifest), (other, described) = made([1.0, 2.0]), made([1.0, 3.0])
    given[0].put(product, manifest)
    (path,) = tmp_path.iterdir()
    given[0].put(other, described)
    next(one for one in tmp_path.iterdir() if one != path).replace(path)
    assert given[1].get(manifest) is None


def test_the_oldest_make_room(given, tmp_path):
    found = [made([float(n)] * 20) for n in range(4)]
    for product, manifest in found:
        given[0].put(product, manifest)
    assert [given[1].get(manifest) is not None for _, manifest in found] == [False, False, True, True]
    given[0].put(*made([0.5] * 60))
    assert len(list(tmp_path.iterdir())) == 2


def test_without_a_folder_nothing_is_written():
    product, manifest = made([1.0])
    alone = Handover()
    alone.put(product, manifest)
    assert alone.get(manifest) is None


def test_the_folder_ends_with_the_run(store):
    with handover_folder(store) as folder:
        (folder / "x.npz").touch()
    assert not folder.exists()


def test_a_full_disk_hands_nothing_over(store, monkeypatch):
    full = OSError(28, "no space left")
    replace_below(monkeypatch, store.path, Path, "mkdir", lambda self, **options: (_ for _ in ()).throw(full))
    with handover_folder(store) as folder:
        assert folder is None


def test_what_was_handed_over_is_not_made_again(store, tmp_path, monkeypatch):
    first, described = made([1.0, 2.0])
    source = Ref(store.put(first, described, keep=True).digest)
    product = normalised(toys.Scale().run(load(store, source), None))
    manifest = store.put(product, describe(product), keep=False)
    given = Handover()
    given.folder = tmp_path
    given.put(product, manifest)
    monkeypatch.setattr(references, "handover", given)
    before = clock.remake_s
    again = load(store, Ref(manifest.digest, Recipe("scale/a", toys.Scale(), {"number": source, "rig": None}, {})))
    np.testing.assert_array_equal(again["values"], [2.0, 4.0])
    assert clock.remake_s == before


@pytest.mark.slow
def test_processes_that_hand_over_give_the_same_products(tmp_path):
    graph = chain(numbers(tmp_path / "numbers", 6), keep="never")
    store, other = Store.open(tmp_path / "one"), Store.open(tmp_path / "other")
    assert index(run_sync(graph, store, scheduler="processes", workers=2)) == index(run_sync(graph, other))
    assert list((store.path / "tmp").iterdir()) == []
