import numpy as np
import pytest

from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.cloud import Cloud
from dicflow.kinds.disparity import DisparityMap
from dicflow.kinds.features import FeatureSet
from dicflow.kinds.images import Images
from dicflow.kinds.increment import Increment, StrainIncrement
from dicflow.kinds.kind import GRID, Kind, Layout, laid_out, summary_of
from dicflow.kinds.matches import Matches
from dicflow.kinds.region import Region
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.track import Track

READERS = {
    "corners": BoardMarks,
    "cloud": Cloud,
    "disparity": DisparityMap,
    "features": FeatureSet,
    "images": Images,
    "rectified": Images,
    "plane": Images,
    "increment": Increment,
    "strain_increment": StrainIncrement,
    "matches": Matches,
    "region": Region,
    "rig": CalibratedRig,
    "track": Track,
}


@pytest.mark.parametrize(("kind", "reader"), READERS.items())
def test_a_reader_takes_its_own_kind(kind: str, reader: type[Kind]):
    product = Product(kind)
    assert reader.read(product).product is product


@pytest.mark.parametrize("reader", sorted(set(READERS.values()), key=lambda reader: reader.__name__))
def test_a_reader_refuses_another_kind_and_names_both(reader: type[Kind]):
    with pytest.raises(StageError) as refusal:
        reader.read(Product("maps"))
    message = str(refusal.value)
    assert "maps" in message
    assert all(kind in message for kind in reader.KINDS)


def test_no_two_readers_take_one_kind():
    kinds = [kind for reader in set(READERS.values()) for kind in reader.KINDS]
    assert sorted(kinds) == sorted(READERS)


def test_a_layout_gives_values_their_axes_unit_and_name():
    values = np.arange(6.0).reshape(2, 3)
    array = Layout(GRID, "mm", "depth")(values)
    assert array.values is values
    assert (array.dims, array.units, array.long_name) == (("row", "col"), "mm", "depth")


def test_arrays_keep_the_order_of_the_values():
    layouts = {"a": Layout(GRID), "b": Layout(GRID), "c": Layout(GRID)}
    assert list(laid_out(layouts, {"c": np.zeros((1, 1)), "a": np.zeros((1, 1))})) == ["c", "a"]


def test_a_product_without_summary_has_an_empty_one():
    assert summary_of(Product("rig")) == {}
    assert summary_of(Product("rig", attrs={"summary": {"rms_px": 0.1}})) == {"rms_px": 0.1}
