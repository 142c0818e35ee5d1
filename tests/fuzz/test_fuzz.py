"""A sample of ``make fuzz``, and what the harness notes."""

from __future__ import annotations

import pytest

from dicflow.errors import InputError
from tests.fuzz import harness
from tests.fuzz.harness import Target, findings
from tests.fuzz.targets import targets

pytestmark = pytest.mark.slow

TARGETS = targets()


@pytest.mark.parametrize("target", TARGETS, ids=[target.name for target in TARGETS])
def test_a_changed_file_gives_a_result_or_a_message(target, tmp_path):
    assert not list(findings(target, 100, tmp_path))


@pytest.mark.parametrize("target", TARGETS, ids=[target.name for target in TARGETS])
def test_the_files_to_start_from_are_read(target, tmp_path):
    for seed in target.seeds:
        path = tmp_path / target.file
        path.write_bytes(target.pack(seed, _Never()))
        target.read(path)


class _Never:
    """Chances that change nothing."""

    def random(self):
        return 0.4

    def choice(self, values):
        return values[0]


@pytest.mark.parametrize(
    ("read", "problem"),
    [
        (lambda path: [1.0, {"a": (2.0, float("nan"))}], None),
        (lambda path: [1e308], "1e+308"),
        (lambda path: _raise(InputError(str(path), "is wrong", "fix it")), None),
        (lambda path: _raise(InputError(str(path), "is wrong", "")), "without file or remedy"),
        (lambda path: _raise(InputError("x", "is wrong", "fix it")), "without file or remedy"),
        (lambda path: _raise(InputError(f"{path}: is wrong")), "without file or remedy"),
        (lambda path: _raise(InputError(str(path), "\x1b[2J", "fix it")), "control characters"),
        (lambda path: _raise(ValueError("broken")), "ValueError: broken"),
        (lambda path: sum(1 for _ in iter(int, 1)), "more than 0.1 s"),
    ],
)
def test_what_is_handled_wrongly_is_noted(read, problem, tmp_path, monkeypatch):
    monkeypatch.setattr(harness, "MOST_SECONDS", 0.1)
    found = list(findings(Target("toy", "toy.txt", (b"a",), read), 1, tmp_path))
    assert [problem in one.problem for one in found] == ([] if problem is None else [True])


def _raise(error):
    raise error
