"""Read settings: a TOML file of options, for all commands and for single ones."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from os import PathLike
from typing import Any

from slopecli.errors import InputError
from slopecli.io.files import read_file

WANTED = 'needed lines such as camera = "camera.json", for all commands, or below [map] for one'


def read_settings(path: str | PathLike[str], commands: Mapping[str, Mapping[str, str]], command: str) -> dict[str, Any]:
    """The settings of a command by parameter, as a user would write them on the command line.

    Parameters
    ----------
    commands : of every command, its options as users write them, without dashes in front -> name of the parameter.
    command : the one that is run.

    Raises
    ------
    InputError : the file cannot be read, or names a command or an option that there is not.
    """
    try:
        document = tomllib.loads(read_file(path, "settings file").decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no TOML ({error}); {WANTED}") from error
    tables = {name: value for name, value in document.items() if isinstance(value, dict)}
    if unknown := sorted(set(tables) - set(commands)):
        raise InputError(f"{path}: there is no command {unknown[0]!r}; there are {', '.join(sorted(commands))}")
    shared = {name: value for name, value in document.items() if name not in tables}
    everything = {name for options in commands.values() for name in options}
    for name in shared:
        if _spelt(name) not in everything:
            raise InputError(f"{path}: no command has an option --{_spelt(name)}; {WANTED}")
    for table, values in tables.items():
        for name in values:
            if _spelt(name) not in commands[table]:
                raise InputError(
                    f"{path}: slopemap {table} has no option --{_spelt(name)}; see slopemap {table} --help"
                )
    wanted = {**shared, **tables.get(command, {})}
    known = commands[command]
    return {known[_spelt(name)]: _written(path, name, value) for name, value in wanted.items() if _spelt(name) in known}


def _spelt(name: str) -> str:
    """An option as users write it: free-focal for free_focal."""
    return name.replace("_", "-")


def _written(path: str | PathLike[str], name: str, value: Any) -> Any:
    """A value as on the command line: numbers of a list with commas between, texts of a list as several options."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list) and value and all(isinstance(one, int | float) for one in value):
        return ",".join(map(repr, value))
    if isinstance(value, list) and value and all(isinstance(one, str) for one in value):
        return value
    raise InputError(f"{path}: {name} = {value!r} is no text, number, true or false, or list of these; {WANTED}")
