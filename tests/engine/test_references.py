import numpy as np
import pytest
import toys
from toys import field

from dicflow.engine.objects import describe, normalised
from dicflow.engine.references import ProductCache, Recipe, Ref, Series, cache, clock, load
from dicflow.engine.work import is_kept
from dicflow.errors import StoreError


def put(store, values, keep=True):
    product = normalised(field("number", values))
    return store.put(product, describe(product), keep).digest


def test_a_series_is_like_a_tuple_that_opens_each_step_when_it_is_used(store, monkeypatch):
    refs = tuple((f"step_{n}", Ref(put(store, [n]))) for n in range(4))
    series = Series(store, refs)
    opened = []
    monkeypatch.setattr(store, "manifest", lambda digest, find=store.manifest: opened.append(digest) or find(digest))
    assert (len(series), series.steps) == (4, ("step_0", "step_1", "step_2", "step_3"))
    assert opened == []
    assert series[-1]["values"] == [3]
    assert opened == [refs[3][1].digest]
    assert [product["values"][0] for product in series] == [0, 1, 2, 3]
    assert [product["values"][0] for product in series[1:3]] == [1, 2]
    assert series[1:3].steps == ("step_1", "step_2")


def test_what_is_not_kept_is_made_again_from_its_inputs(store):
    first = Ref(put(store, [1.0, 2.0]))
    recipe = Recipe("scale/a", toys.Scale(), {"number": first, "rig": None}, {})
    product = normalised(toys.Scale().run(load(store, first), None))
    ref = Ref(store.put(product, describe(product), keep=False).digest, recipe)
    before = clock.remake_s
    again = load(store, ref)
    assert (again.kind, again.attrs, clock.remake_s) == ("number", {"summary": {"first": 1.0}}, before)
    np.testing.assert_array_equal(again["values"], [2.0, 4.0])
    assert clock.remake_s > before


def test_an_array_belongs_to_whoever_asked_for_it(store):
    product = normalised(field("number", [1.0, 2.0]))
    manifest = store.put(product, describe(product), keep=True)
    cache.put(manifest.digest, product, manifest.nbytes)
    load(store, Ref(manifest.digest))["values"][:] = 0
    np.testing.assert_array_equal(load(store, Ref(manifest.digest))["values"], [1.0, 2.0])


def test_a_product_that_has_gone_is_an_error(store):
    with pytest.raises(StoreError, match="is missing; run again"):
        load(store, Ref("sha256:" + "0" * 64))


def test_the_cache_holds_what_was_used_last_within_its_limit():
    small = ProductCache(limit=100)
    for name in "abc":
        small.put(name, field(name, []), 40)
        small.get("a")
    assert [small.get(name) is not None for name in "abc"] == [True, False, True]
    small.put("too large", field("x", []), 101)
    assert small.get("too large") is None


def test_the_cache_holds_so_many_products_at_most_however_small():
    small = ProductCache(limit=100, most=3)
    for name in "abcde":
        small.put(name, field(name, []), 1, kept=name == "d")
    assert [small.get(name) is not None for name in "abcde"] == [False, True, True, False, True]


def test_what_is_in_the_store_gives_way_to_what_would_be_made_again():
    small = ProductCache(limit=100)
    for name, kept in (("a", False), ("b", True), ("c", False)):
        small.put(name, field(name, []), 40, kept)
    assert [small.get(name) is not None for name in "abc"] == [True, False, True]
    small.put("d", field("d", []), 40, True)
    assert [small.get(name) is not None for name in "acd"] == [False, True, True]


def test_depth_counts_stages_that_must_run():
    kept = Ref("a")
    one = Ref("b", Recipe("b", toys.Scale(), {"number": kept}, {}))
    two = Ref("c", Recipe("c", toys.Scale(), {"number": one, "rig": kept, "x": (("s", kept),)}, {}))
    assert (kept.depth, one.depth, two.depth) == (0, 1, 2)


@pytest.mark.parametrize(
    ("node", "arrays", "nbytes", "seconds", "depth", "gathered", "kept"),
    [
        (toys.Scale(), 1, 23_000_000, 0.05, 1, False, False),
        (toys.Scale(), 1, 23_000_000, 1.0, 1, False, True),
        (toys.Scale(), 1, 1_000, 0.001, 1, False, False),
        (toys.Scale(), 1, 1_000, 0.1, 1, False, True),
        (toys.Scale(), 12, 1_000, 0.02, 1, False, False),
        (toys.Scale(keep="always"), 1, 1_000, 0.0, 1, False, True),
        (toys.Scale(keep="never"), 1, 1_000, 9.0, 1, False, False),
        (toys.Scale(keep="never"), 1, 1_000, 9.0, 4, False, True),
        (toys.Scale(), 1, 1_000, 0.0, 1, True, True),
        (toys.Scale(keep="never"), 1, 1_000, 0.0, 1, True, False),
        (toys.Total(keep="never"), 1, 1_000, 0.0, 1, False, True),
        (toys.Rig(keep="never"), 1, 1_000, 0.0, 1, False, True),
    ],
)
def test_what_is_kept(node, arrays, nbytes, seconds, depth, gathered, kept):
    assert is_kept(node, arrays, nbytes, seconds, depth, gathered) == kept
