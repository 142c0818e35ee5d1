"""A cluster by its name, or by a file that says what its jobs need."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from dicflow.discovery import nearest
from dicflow.engine.cluster_spec import KINDS, ClusterSpec
from dicflow.engine.units import quantity
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import Document, read

__all__ = ["cluster_in", "cluster_of", "workers_of"]

_KEYS = ("cluster", "options", "wait")
_RANGE = re.compile(r"([0-9]{1,5})(?:\.\.([0-9]{1,5}))?")


def workers_of(text: str) -> tuple[int, int]:
    """The least and the greatest number of workers. Raises ConfigurationError for anything else.

    >>> workers_of("4"), workers_of("2..40")
    ((4, 4), (2, 40))
    """
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        raise ConfigurationError(f"--workers {text}: write a number such as 4, or a range such as 2..40")
    least, most = int(found[1]), int(found[2] or found[1])
    if least < 1:
        raise ConfigurationError(f"--workers {text}: the number must be at least 1")
    if least > most:
        raise ConfigurationError(f"--workers {text}: write the smaller number first, {most}..{least}")
    return least, most


def cluster_of(given: str, least: int, most: int) -> ClusterSpec:
    """The cluster that ``--cluster`` names: one of :data:`~dicflow.engine.cluster_spec.KINDS`, or a YAML file.

    The file has ``cluster``, a name or ``package.module.Class``; ``options``, the arguments of its class; and ``wait``,
    how long the first job may wait in the queue. Raises ConfigurationError with the place of what is wrong.
    """
    if given in KINDS or not given.lower().endswith((".yaml", ".yml")):
        return ClusterSpec(given, {}, least, most)
    return cluster_in(read(Path(given)), least, most)


def cluster_in(document: Document, least: int, most: int) -> ClusterSpec:
    """The cluster of a file. Raises ConfigurationError with the place of what is wrong."""
    for key in document.data:
        if key not in _KEYS:
            known = ", ".join(_KEYS)
            _fail(document, key, f"unknown key '{key}'{nearest(str(key), _KEYS)}; keys: {known}")
    kind, options = document.data.get("cluster"), document.data.get("options", {})
    if not isinstance(kind, str):
        _fail(document, "cluster", f"name the cluster: {', '.join(KINDS)}, or the class of another one")
    if not isinstance(options, Mapping):
        _fail(document, "options", "write the options as 'name: value', one per line")
    try:
        return ClusterSpec(kind, options, least, most, **_patience(document))
    except ConfigurationError as error:
        raise ConfigurationError(f"{document.where(('cluster',))}: {error}") from error


def _patience(document: Document) -> dict[str, float]:
    given = document.data.get("wait")
    if given is None:
        return {}
    try:
        seconds = float(quantity("s")(given))
    except (ValueError, TypeError) as error:
        _fail(document, "wait", f"{error}")
    if not seconds > 0.0:
        _fail(document, "wait", "write a time above 0, such as 2 h")
    return {"wait_s": seconds}


def _fail(document: Document, key: Any, problem: str) -> NoReturn:
    raise ConfigurationError(f"{document.where((key,))}: {problem}")
