"""What ``--cluster`` and ``--workers`` name."""

import pytest

from dicflow.engine.cluster_spec import ClusterSpec
from dicflow.errors import ConfigurationError
from dicflow.io.cluster_file import cluster_of, workers_of
from tests.small import dicflow


def written(folder, text):
    path = folder / "cluster.yaml"
    path.write_text(text)
    return str(path)


def test_a_name_alone():
    assert cluster_of("pbs", 2, 40) == ClusterSpec("pbs", {}, 2, 40)


def test_a_file(tmp_path):
    text = "cluster: slurm\noptions: {queue: short, cores: 2, walltime: '01:00:00'}\nwait: 2 min\n"
    expected = ClusterSpec("slurm", {"queue": "short", "cores": 2, "walltime": "01:00:00"}, 1, 4, 120.0)
    assert cluster_of(written(tmp_path, text), 1, 4) == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cluster: slrm\n", "cluster.yaml:1:1: unknown cluster 'slrm', did you mean 'slurm'"),
        ("options: {}\n", "name the cluster: slurm, pbs, lsf, sge, ssh"),
        ("cluster: slurm\noption: {}\n", "cluster.yaml:2:1: unknown key 'option'"),
        ("cluster: slurm\noptions: [queue]\n", "cluster.yaml:2:1: write the options as"),
        ("cluster: slurm\nwait: soon\n", "cluster.yaml:2:1: 'soon' is not a quantity in s"),
        ("cluster: slurm\nwait: 0\n", "cluster.yaml:2:1: write a time above 0"),
        ("cluster: [\n", "cluster.yaml:"),
    ],
)
def test_a_file_that_is_wrong(tmp_path, text, words):
    with pytest.raises(ConfigurationError, match=words):
        cluster_of(written(tmp_path, text), 1, 1)


@pytest.mark.parametrize("text", ["", "2..", "a", "2-4", "-1", "1..2..3"])
def test_numbers_of_workers_that_are_wrong(text):
    with pytest.raises(ConfigurationError, match="write a number such as 4, or a range such as 2"):
        workers_of(text)


def test_a_range_of_workers_that_falls():
    with pytest.raises(ConfigurationError, match=r"--workers 40\.\.2: write the smaller number first, 2\.\.40"):
        workers_of("40..2")


def test_the_command_refuses_what_does_not_go_together(tmp_path):
    pipeline = tmp_path / "p.yaml"
    pipeline.write_text("stages: {photos: {stage: images, left: '*.png'}}\n")
    dicflow("run", pipeline, "--workers", "2..4").refuses(2, "a range is for --cluster")
    dicflow("run", pipeline, "--cluster", "slrm").refuses(2, "unknown cluster 'slrm'", "slurm")
    dicflow("run", pipeline, "--cluster", "slurm", "--scheduler", "sync").refuses(2, "leave --scheduler out")
    dicflow("run", pipeline, "--cluster", "slurm", "--workers", "0").refuses(2, "at least 1")
    dicflow("run", pipeline, "--cluster", "none.yaml").refuses(2, "none.yaml")
