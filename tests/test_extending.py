"""The page on extending dicflow: its code is run unchanged."""

import re
import tomllib

import numpy as np
import pytest
from small import ROOT, STEPS

from dicflow.pipeline import Pipeline
from tests.installed import Site

PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^`(\S+)`\n```\w+\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


@pytest.fixture
def site(tmp_path):
    """The package of the page, installed as its ``pyproject.toml`` says."""
    project = tomllib.loads(FILES["pyproject.toml"])["project"]
    made = Site(tmp_path / "site")
    made.install(project["name"], {"lab_dic/__init__.py": "", **FILES}, project["entry-points"])
    return made


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".py")])
def test_the_code_is_short(name):
    assert len(FILES[name].splitlines()) < 30


def test_every_block_of_code_is_a_file():
    assert len(FILES) == PAGE.count("```") // 2 - 3 == 5


def test_the_stage_divides_mean_strains(site, copied):
    text = copied.read_text()
    copied.write_text(text + "  ratio: {stage: poisson}\n")
    site.dicflow("run", copied, "--scheduler", "sync", "--workers", 1)
    shown = site.dicflow("show", copied, "ratio")
    site.dicflow("export", copied, "ratio", "--output", copied.parent / "out")
    copied.write_text(text)
    totals = [Pipeline.load(copied).result().product("total", step) for step in range(STEPS - 1)]
    expected = -np.nanmean(totals[-1]["exx"]) / np.nanmean(totals[-1]["eyy"])
    assert float(re.search(r'"poisson": (\S+)', shown)[1]) == pytest.approx(expected)
    assert 0.2 < expected < 0.6
    page = (copied.parent / "results" / copied.stem / "report.html").read_text()
    assert f"<p>ratio: {expected:.3f}</p>" in page
    table = (copied.parent / "out" / "ratio.csv").read_text().splitlines()
    rows = [line.split(",") for line in table if not line.startswith("#")]
    assert rows[0] == ["step", "ratio"]
    assert rows[-1][0] == Pipeline.load(copied).result().steps("total")[-1]
    assert float(rows[-1][1]) == pytest.approx(expected)


def test_the_export_format_writes_the_places_of_a_step(site, copied, tmp_path):
    site.dicflow("export", copied, "--format", "xyz", "--output", tmp_path / "out")
    total = Pipeline.load(copied).result().product("total", -1)
    places = total["xyz_reference"] + np.stack([total[name] for name in "UVW"], axis=-1)
    measured = np.isfinite(places).all(axis=-1) & np.isfinite(total["exx"])
    written = np.loadtxt(max((tmp_path / "out").glob("total_*.xyz")))
    np.testing.assert_allclose(written, places[measured], atol=1e-6)


def test_the_stage_lists_its_parameters(site):
    assert "  along: eyy\n      exx | eyy\n      strain along the load\n" in site.dicflow("stages", "poisson")


MEASURED = """
import numpy as np
from dicflow.stages.deformation import Deformation
from tests.stages.measured_points import points, sheet

stretch = np.array([0.8, 1.5, 1.0])
node = Deformation(measure="swainger", window=30.0)
total = node.run(points=points(sheet() * stretch), points_first=points(sheet()))
print(node.uses(), total.attrs["measures"]["eyy"], *(np.nanmean(total[name]) for name in ("exx", "eyy", "e1")), sep="|")
print(np.nanmin(total["sigma_eyy"]) > 0.0)
"""


@pytest.mark.slow
def test_the_measure_is_computed_along_x_and_y_with_its_uncertainty(site):
    done = site.python("-c", MEASURED)
    assert done.returncode == 0, done.stderr
    (uses, title, *strains), (has_sigma,) = (line.split("|") for line in done.stdout.splitlines())
    assert uses == "('lab_dic.swainger:strain',)"
    assert title.startswith("Swainger strain")
    assert [float(strain) for strain in strains] == pytest.approx([1 - 1 / 0.8, 1 - 1 / 1.5, 1 - 1 / 1.5], abs=1e-4)
    assert has_sigma == "True"


def test_an_unknown_measure_is_refused_with_the_known_ones(site):
    done = site.python("-c", "from dicflow.stages.deformation import Deformation as D; D(measure='swinger')")
    assert "unknown measure of strain 'swinger', did you mean 'swainger'" in done.stderr


def test_the_check_of_the_measure_gives_what_the_page_says(site):
    code = re.search(r"^```\n(from dicflow.core.strain.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[1]
    ends = "\nprint(*found.e1.ravel(), *found.e2.ravel())"
    done = site.python("-c", "import numpy as np\nfrom lab_dic.swainger import strain\n" + code + ends)
    stretch = 0.25 + np.sqrt(0.25**2 + 1.0)
    np.testing.assert_allclose(np.array(done.stdout.split(), dtype=float), [1 - 1 / stretch, 1 - stretch])
