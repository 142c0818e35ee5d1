"""The errors a user can meet, all under one root.

::

    DicflowError
    ├── ConfigurationError   the YAML, a parameter or a command line is wrong   (exit code 2)
    ├── InputError           a file that the user brings is missing or unusable (exit code 2)
    ├── StageError           a stage could not do its work on its inputs        (exit code 1)
    ├── WorkerError          no worker is left, or the scheduler has ended      (exit code 1)
    └── StoreError           the store cannot be read or written                (exit code 2)
        ├── DamagedError     a product in it is damaged                         (exit code 1)
        └── NotKeptError     a product was not kept and cannot be made again    (exit code 2)

Exit code 2 means that nothing was done, because the input is unusable. An error within a task fails that task alone,
and the run ends with 1.

Every message is a sentence that says what was expected, what was found, where, and what to do. An error of a file that
the user brings is made of these parts, ``InputError(where, problem, remedy)``; others are made of the whole message.
Any other exception that reaches a user is a defect of dicflow.
"""

from __future__ import annotations

__all__ = [
    "ConfigurationError",
    "DamagedError",
    "DicflowError",
    "InputError",
    "NotKeptError",
    "StageError",
    "StoreError",
    "WorkerError",
]


class DicflowError(Exception):
    """Root of all errors with a message for users: one text, or its three parts, ``where: problem; remedy``."""

    exit_code = 1

    def __str__(self) -> str:
        if len(self.args) != 3:
            return super().__str__()
        where, problem, remedy = self.args
        return f"{where}: {problem}; {remedy}"


class ConfigurationError(DicflowError):
    """The pipeline file, a parameter or an option of the command line is wrong."""

    exit_code = 2


class InputError(DicflowError):
    """A file that the user brings is missing, unreadable or does not fit the others."""

    exit_code = 2


class StageError(DicflowError):
    """A stage could not do its work on the inputs it was given."""


class WorkerError(DicflowError):
    """The processes that do the work cannot be started or reached."""


class StoreError(DicflowError):
    """The store cannot be read or written as needed."""

    exit_code = 2


class DamagedError(StoreError):
    """An object in the store is damaged; it has been moved into quarantine."""

    exit_code = 1


class NotKeptError(StoreError):
    """A product was not kept, and an input for making it again is missing."""
