"""A calibrated rig as JSON: the form it has in a product's attributes and in a file of its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.rig_parameters import PARAMETERS
from dicflow.errors import InputError
from dicflow.io.json_text import read_json
from dicflow.kinds.rig import rig_from_json, rig_to_json

__all__ = ["read_covariance", "read_rig", "rig_text", "write_rig"]

_T = TypeVar("_T")

_MAX_BYTES = 1_000_000
_LARGEST = 1e9
_ROUNDING = 1e-6
"""Greatest departure of a correlation matrix from a symmetric one without negative eigenvalues."""


def write_rig(path: Path, rig: Rig, covariance: Any = None) -> None:
    """Write the rig to a JSON file, with the covariance of its numbers if it is known."""
    path.write_text(rig_text(rig, covariance), encoding="utf-8")


def rig_text(rig: Rig, covariance: Any = None) -> str:
    """The rig as the text of a JSON file.

    covariance : (24, 24) — of :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`; None if unknown
    """
    known = {} if covariance is None else {"covariance": np.asarray(covariance, dtype=float).tolist()}
    return json.dumps({**rig_to_json(rig), **known}, indent=2) + "\n"


def read_rig(path: Path) -> Rig:
    """Read what :func:`write_rig` wrote. Raises InputError if the file does not hold a rig."""
    return _read(path, _bounded_rig, "export the rig again")


def read_covariance(path: Path) -> np.ndarray | None:
    """The covariance (24, 24) that :func:`write_rig` wrote beside a rig, None if the file has none.

    Raises InputError if it is not a matrix of this size, not symmetric, or not positive semidefinite.
    """
    return _read(path, _covariance_or_none, "export the rig again, or leave its covariance out")


def _read(path: Path, convert: Callable[[Mapping[str, Any]], _T], remedy: str) -> _T:
    values = read_json(path, "a rig", _MAX_BYTES)
    try:
        if not isinstance(values, dict):
            raise ValueError(f"found {type(values).__name__}")
        return convert(values)
    except KeyError as error:
        raise InputError(str(path), f"expected a rig, but the entry {error} is missing", remedy) from error
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(str(path), f"expected a rig as dicflow writes it, but {error}", remedy) from error


def _bounded_rig(values: Mapping[str, Any]) -> Rig:
    rig = rig_from_json(values)
    parts = [*rig.left, *rig.right, rig.rotation, rig.translation]
    if np.abs(np.concatenate([np.ravel(np.asarray(part)) for part in parts])).max() > _LARGEST:
        raise ValueError(f"it has numbers beyond {_LARGEST:g}")
    return rig


def _covariance_or_none(values: Mapping[str, Any]) -> np.ndarray | None:
    return _covariance(values["covariance"]) if "covariance" in values else None


def _covariance(values: Any) -> np.ndarray:
    """A covariance of the rig's numbers. Raises ValueError if it is not one."""
    found = _numbers(values, (len(PARAMETERS), len(PARAMETERS)), "covariance")
    variances = np.diagonal(found)
    if (variances < 0.0).any():
        raise ValueError("covariance has negative variances")
    units = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    with np.errstate(all="ignore"):
        correlation = found / np.outer(units, units)
    if not np.isfinite(correlation).all():
        raise ValueError("covariance has numbers without bounds")
    if np.abs(correlation - correlation.T).max() > _ROUNDING:
        raise ValueError("covariance is not symmetric")
    if np.linalg.eigvalsh(correlation)[0] < -_ROUNDING:
        raise ValueError("covariance is not positive semidefinite")
    return found


def _numbers(values: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} is not {' × '.join(map(str, shape))} finite numbers")
    return array
