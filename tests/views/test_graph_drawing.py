"""The graph as text and as SVG."""

from xml.etree import ElementTree

import pytest

from dicflow.pipeline import Pipeline
from dicflow.views.graph import Mark, graph_svg, graph_text

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def graph(pipeline):
    return Pipeline.load(pipeline).graph


def test_every_stage_stands_below_those_it_takes_from(graph):
    names = [line.split()[0] for line in graph_text(graph).splitlines()]
    assert sorted(names) == sorted(graph.stages)
    for name, spec in graph.stages.items():
        assert all(names.index(producer) < names.index(name) for producer in spec.inputs.values())


def test_the_drawing_has_a_box_per_stage_and_an_arrow_per_input(graph):
    root = ElementTree.fromstring(graph_svg(graph))
    boxes = [node for node in root.iter(f"{SVG}rect") if node.get("rx")]
    arrows = [node for node in root.iter(f"{SVG}path") if node.get("marker-end")]
    assert len(boxes) == len(graph.stages)
    assert len(arrows) == sum(len(spec.inputs) for spec in graph.stages.values())
    places = {(box.get("x"), box.get("y")) for box in boxes}
    assert len(places) == len(boxes)
    width, height = float(root.get("width")), float(root.get("height"))
    assert all(float(x) + 190 < width and float(y) + 46 < height for x, y in places)


def test_the_drawing_runs_nothing_and_fetches_nothing(graph):
    text = graph_svg(graph)
    assert graph_svg(graph) == text
    tags = {node.tag.removeprefix(SVG) for node in ElementTree.fromstring(text).iter()}
    assert tags == {"svg", "defs", "marker", "g", "path", "rect", "text", "title"}
    assert text.count("http") == 1


def test_what_became_of_a_stage_is_its_class_and_note(graph):
    root = ElementTree.fromstring(graph_svg(graph, {"track": Mark("failed", "<1> failed")}))
    groups = {node.find(f"{SVG}text").text: node for node in root.iter(f"{SVG}g")}
    assert groups["track"].get("class") == "stage failed"
    assert groups["track"].findall(f"{SVG}text")[1].text.endswith("<1> failed")
    assert groups["rig"].get("class") == "stage planned"
