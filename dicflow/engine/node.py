"""Nodes: one frozen pydantic model per stage, and the types of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from dicflow.engine.files import FilePart
from dicflow.engine.product import Product
from dicflow.engine.units import quantity

__all__ = [
    "Affects",
    "At",
    "Degrees",
    "InputFile",
    "Joined",
    "Keep",
    "Millimetres",
    "Node",
    "Odd",
    "Pixels",
    "Port",
    "Scope",
    "Seconds",
    "Steps",
    "keeping",
    "numbered_port",
    "parameter",
    "port_of",
]


Steps = Mapping[str, Mapping[str, Path | FilePart]]
"""Steps of a series in order, each with its files: step → argument of ``run`` → file, or part of one."""


class Joined(NamedTuple):
    """A stage joined to an input of another one, as it is known before anything runs.

    steps : names of its steps; empty for one that runs once
    facts : argument of ``run`` → what :meth:`Node.check` found in the file of the first of these steps; of the stage
        whose files these are
    files : its own, in their order
    inputs : port → stage joined to it
    is_whole : whether these steps are all that there will be
    """

    node: Node
    steps: tuple[str, ...]
    facts: Mapping[str, Mapping[str, Any]]
    files: tuple[Path | FilePart, ...]
    inputs: Mapping[str, Joined]
    is_whole: bool = True


class Scope(StrEnum):
    """What a stage repeats over.

    The steps are those of the images that its inputs descend from; a stage with files of its own
    (``Node.steps``) starts a new series of steps.
    """

    RIG = "rig"
    """Once for the cameras: takes all steps of the board photographs."""
    STEP = "step"
    """Once for each step."""
    PAIR = "pair"
    """Once for each step but the first: from the step before to this one."""
    TEST = "test"
    """Once for all steps."""


class At(StrEnum):
    """Which step of its producer an input takes, seen from step k of the consumer."""

    SAME = "same"
    """Step k; of a pair, the one that ends in k (None at the first step); the only one of a rig or test."""
    PREVIOUS = "previous"
    """Step k − 1; None at the first step of a STEP stage. A stage may take its own output so."""
    FIRST = "first"
    """The first step, the reference."""
    ALL = "all"
    """A tuple of all steps in order, each read when it is first used."""
    EARLY = "early"
    """The same of a few steps after the first: those that follow it by 1, 2, 4, 8 and 16. Steps added later leave them
    as they are."""


@dataclass(frozen=True)
class Port:
    """One input of a stage.

    kinds : kinds of product that fit
    at : which step is taken
    optional : the stage also works without it and then gets None
    own : the producer is this stage itself, at another step
    of : another port; unless named, the producer is what the stage joined to that port takes by the same name
    several : a pipeline may name a list of stages, by default all that fit; with ``At.ALL``, whose tuple has the
        products of all of them, under ``.steps`` the name of the step or of a stage that runs once
    """

    kinds: tuple[str, ...]
    at: At = At.SAME
    optional: bool = False
    own: bool = False
    of: str = ""
    several: bool = False

    def __init__(
        self,
        *kinds: str,
        at: At = At.SAME,
        optional: bool = False,
        own: bool = False,
        of: str = "",
        several: bool = False,
    ) -> None:
        object.__setattr__(self, "kinds", kinds)
        object.__setattr__(self, "at", at)
        object.__setattr__(self, "optional", optional)
        object.__setattr__(self, "own", own)
        object.__setattr__(self, "of", of)
        object.__setattr__(self, "several", several)


def numbered_port(port: str, number: int) -> str:
    """Name under which a stage keeps one of several stages joined to a port: ``curves``, ``curves[1]`` …"""
    return f"{port}[{number}]" if number else port


def port_of(name: str) -> str:
    """The port of a name that :func:`numbered_port` gave."""
    return name.partition("[")[0]


Affects = Literal["result", "speed", "report"]


def parameter(
    default: Any = ..., description: str = "", *, unit: str = "", affects: Affects = "result", **limits: Any
) -> Any:
    """A parameter of a node: its default, meaning, unit and limits (``gt``, ``ge``, ``le`` … of pydantic).

    Only parameters that affect the result enter a key.
    """
    return Field(default, description=description, json_schema_extra={"unit": unit, "affects": affects}, **limits)


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError(f"{value} is even; use an odd number ({value + 1} is the next)")
    return value


Millimetres = Annotated[float, BeforeValidator(quantity("mm"))]
"""A length; a bare number is in mm, text carries its unit: ``"2 cm"``."""
Pixels = Annotated[float, BeforeValidator(quantity("px"))]
"""A length in the image; a bare number is in px."""
Degrees = Annotated[float, BeforeValidator(quantity("deg"))]
"""An angle; a bare number is in degrees, text may say ``"0.1 rad"``."""
Seconds = Annotated[float, BeforeValidator(quantity("s"))]
"""A time; a bare number is in seconds, text may say ``"5 min"``."""
Odd = Annotated[int, AfterValidator(_odd)]
"""The side of a window with a pixel in its middle."""
InputFile = Annotated[str, Field(json_schema_extra={"file": True})]
"""Path of a file that the user brings. Its contents, not its path, enter the key; ``run`` gets the Path."""


Keep = Literal["always", "auto", "never"]


def keeping(default: Keep) -> Any:
    """The field ``keep`` of a stage; "always" for products that people look at again and again."""
    text = "whether the product is kept in the store; auto keeps products that take longer to remake than to read"
    return parameter(default, text, affects="speed")


class Node(BaseModel):
    """A stage: its parameters as fields, its place in the graph as class variables, its work in :meth:`run`.

    A subclass declares ``stage: Literal["its name"]`` and the class variables below. ``run`` is a pure function of the
    parameters and its keyword arguments: one per port of ``takes`` (a :class:`Product`, a tuple of them for
    ``At.ALL`` and ``At.EARLY``, or None), one per file that :meth:`steps` names, and one ``<field>_path`` per
    :data:`InputFile` given.
    It imports its chapters of ``core`` inside, so that planning a run loads no numerics.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    title: ClassVar[str]
    """What it does, as the graph and the progress display name it."""
    scope: ClassVar[Scope]
    takes: ClassVar[Mapping[str, Port]] = {}
    gives: ClassVar[str]
    """Kind of the product."""
    follows: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Port → parameters that default to those of the stage joined to it."""
    impl_version: ClassVar[int] = 1
    """Raised by hand whenever the same inputs may give other results."""
    is_quick: ClassVar[bool] = False
    """Whether its tasks are usually short and need no compiled code; the program does them while its workers start."""

    stage: str
    keep: Keep = keeping("auto")

    def searches(self, folder: Path) -> tuple[Path, ...]:
        """The folders in which :meth:`steps` looks for files; they are checked before it does.

        folder : where relative paths start
        """
        return ()

    def steps(self, folder: Path) -> Steps | None:
        """Files of each step, for a stage that starts a series of steps: step name → argument of run → path.

        folder : where relative paths start
        Returns None for every other stage. Raises InputError if the files are not a series.
        """
        return None

    def steps_so_far(self, folder: Path, is_whole: Callable[[Path], bool]) -> Steps | None:
        """The same of a series to which files are added: what is not whole, or lacks a partner, is not in it yet.

        is_whole : whether a file is no longer being written
        """
        steps = self.steps(folder)
        if steps is None:
            return None
        return {step: files for step, files in steps.items() if all(is_whole(Path(file)) for file in files.values())}

    def finds(self, folder: Path) -> tuple[Path, ...]:
        """The files that :meth:`steps` looks at, also those that it leaves out.

        folder : where relative paths start
        """
        return ()

    def left_out(self, folder: Path, steps: Mapping[str, Mapping[str, Path | FilePart]]) -> tuple[str, ...]:
        """Sentences about files that :meth:`steps` found and left out, or joined, for the warnings of a run.

        steps : what it returned
        """
        return ()

    def check(self, path: Path | FilePart) -> dict[str, Any]:
        """Facts about one file, found before anything runs and kept while the file is unchanged.

        Of a part of a file the fact ``digest``, if given, is that of its contents and enters the key; otherwise the
        contents of the whole file and the number of the part do.
        Raises InputError that names the file if it cannot be used.
        """
        return {}

    def agree(
        self,
        facts: Mapping[Path | FilePart, Mapping[str, Any]],
        steps: Mapping[str, Mapping[str, Path | FilePart]],
        inputs: Mapping[str, tuple[str, ...]],
    ) -> None:
        """Check that all files fit together, before anything runs.

        facts : file → what :meth:`check` returned
        steps : what :meth:`steps` returned; empty for a stage that starts no series
        inputs : port → names of the steps of the stage joined to it; empty for a stage that runs once
        Raises InputError that names the first file that does not fit the others.
        """

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        """Parameters that do not suit the photographs or what is joined, each with what is wrong.

        Or ports, of which the stage joined to them does not suit this one. They are found before anything runs.

        joined : port → the stage joined to it
        """
        return iter(())

    def joins(self, port: str) -> bool:
        """Whether an optional port is joined to a stage, with these parameters."""
        return True

    def gathers(self, port: str) -> bool:
        """Whether :meth:`run` reads arrays of the products of all steps, with these parameters, so that they are kept.

        Attributes are there in any case.
        """
        return True

    def uses(self) -> tuple[str, ...]:
        """Code that :meth:`run` finds while it runs, beside what it imports: it counts as the stage's own.

        Names ``"package.module:definition"`` or ``"package.module"``, of any package; the modules are read, not
        imported. A stage that picks a function by name from a registry names the function, or all modules of the
        registry; so does one that looks for subclasses.
        """
        return ()

    def look(self, **inputs: Any) -> Product:
        """What :meth:`run` needs of one step, of a stage that takes all steps of a series that may be long.

        A stage that defines it names as arguments the port with ``At.ALL``, for which it gets the product of one step,
        and all other ports that it needs. ``run`` then gets what it returned in place of each step's product: a few
        numbers, as arrays that have the same names and shapes at every step, and attributes.
        """
        raise NotImplementedError

    def run(self, **inputs: Any) -> Product:
        """Make the product. Raises StageError if the inputs do not allow it."""
        raise NotImplementedError
