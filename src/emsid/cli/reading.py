r"""The options for reading files, shared by all commands that read records.

Command lines that can be pasted into a shell.

A word is quoted as a POSIX shell reads it. One with control characters or bytes that are no text goes into ``$'…'``,
which bash, zsh and ksh read, so that nothing that a terminal obeys is printed: ``$'a\033b'``.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emsid.cli.options import Command, option, takes
from emsid.errors import DataError, EmsidError
from emsid.options import READING

if TYPE_CHECKING:
    from emsid.first_look import Group
    from emsid.first_look.together import Hypothesis
    from emsid.io import ParsedFile
    from emsid.io.columns import Columns
    from emsid.record import Record


@dataclass(frozen=True)
class Reader:
    """Reads files with the given arguments of `emsid.io.read`.

    Args:
        given: arguments by name.
        usual: defaults of the command.
        recalled_dt: whether the sample time is that of a model file: the clock of a file replaces it.
        recalled_units: columns whose unit is that of a model file: a unit in the header of another file replaces it.
        recalled_from: the columns that the model was identified from, whose headers do not replace it.
    """

    given: Mapping[str, Any]
    usual: Mapping[str, Any]
    recalled_dt: bool = False
    recalled_units: frozenset[str] = frozenset()
    recalled_from: frozenset[str] = frozenset()

    def __call__(self, path: Path, *, in_part: bool = False) -> Record:
        """Read a file, of a very large one an excerpt if that is enough; another sample time stated in it is a finding
        of the record."""
        from emsid.first_look.clock import contradiction, stated_clock
        from emsid.io import ParsedFile, read, read_columns

        parsed = ParsedFile(path, read_columns(path, in_part=in_part, dbc=self.given.get("dbc")))
        given = self.for_columns(parsed.columns)
        if self.recalled_dt and (other := self._by_its_clock(parsed, given)) is not None:
            return other
        record, dt = read(parsed, **given), given.get("dt")
        if dt is None or "time" in given:
            return record
        return replace(
            record, findings=(*record.findings, *contradiction(stated_clock(parsed.columns, path.name), path.name, dt))
        )

    def together(self, paths: Sequence[Path]) -> list[Record]:
        """The records of several files, or excerpts of very large ones; resampled ones have a common step."""
        from emsid.io.reading import common_step

        records = [self(path, in_part=True) for path in paths]
        step = common_step(records, self.given)
        return (
            records
            if step is None
            else [replace(self, given={**self.given, "dt": step})(path, in_part=True) for path in paths]
        )

    def for_columns(self, columns: Columns) -> dict[str, Any]:
        """The arguments for a file, without recalled units of columns whose header in it gives one."""
        from emsid.units import column_of

        given = dict(self.given)
        if self.recalled_units and given.get("units"):
            named = {name: columns.called(column_of(name, columns.series)) for name in self.recalled_units}
            stated = {name for name, each in named.items() if each not in self.recalled_from and columns.unit(each)}
            given["units"] = {name: unit for name, unit in given["units"].items() if name not in stated}
        return given

    def _by_its_clock(self, parsed: ParsedFile, options: Mapping[str, Any]) -> Record | None:
        """The record with the clock of its file, where that has another sample time; None where it has not."""
        from emsid.findings import Finding
        from emsid.first_look.clock import clock_of_file, differs
        from emsid.io import read

        before = options["dt"]
        clock = clock_of_file(parsed.columns, (*options["input"], *options["output"]))
        if clock is None or not differs(clock, before):
            return None
        given: dict[str, Any] = {name: value for name, value in options.items() if name != "dt"}
        if clock.unit and clock.unit_confidence < 1:
            given["time_unit"] = clock.unit
        record = read(parsed, **given, time=clock.column)
        found = Finding("sample-time-of-file", record.name, {"column": clock.column, "dt": record.dt, "before": before})
        return replace(record, findings=(*record.findings, found))

    def with_columns(self, files: Sequence[Path]) -> tuple[Reader, Sequence[Path]]:
        """This reader with the columns that a first look is almost certain of, where none are named, and its files.

        It prints the command that reads the files in the same way.

        Raises:
            DataError: with the commands of the best hypotheses, where the columns are open.
            FormatError: where a file cannot be read.
        """
        if self.given.get("input") or self.given.get("output") or not files:
            return self, files
        from emsid.cli.second_process import meanwhile
        from emsid.cli.terminal import warn

        reading, kept, lines = meanwhile(partial(_certain_columns, files, self.given))()  # a fork: its threads end
        for line in lines:
            warn(line)
        if reading is not None:
            return replace(self, given=reading), kept
        if lines:
            raise DataError("the columns are not certain; choose one of these commands", arguments=("input", "output"))
        return self, files  # the message about missing names follows

    def files(self, files: Sequence[Path]) -> list[Path]:
        """The given files, or the one of the output where that is a column of a named file: ``y.csv:1``.

        Raises:
            DataError: where there is no file, or no input or output is named.
            FormatError: where the columns of a file that cannot be read are not named either.
        """
        from emsid.io import file_and_column, read_columns

        for name in ("input", "output"):
            if not self.given.get(name) and files:
                dbc = self.given.get("dbc")
                read_columns(files[0], dbc=dbc)  # a missing or damaged file is what to mend first
                hint = f"`{command_line(['emsid', 'describe', file_word(str(files[0]))])}` shows the columns"
                raise DataError(f"{_kind_in_words(files[0], dbc)}name the {name} column; {hint}", arguments=(name,))
        names = [re.sub(r"^d\((.+)\)$", r"\1", name) for name in self.given.get("output", ())]
        found = [file_and_column(name) for name in names]
        files = list(files) or [each[0] for each in found if each][:1]
        if not files:
            raise DataError("missing argument 'FILE'; give a file, or columns of files, such as --output y.csv:1")
        return files

    @property
    def typed(self) -> list[str]:
        """The names of the options that the user gave."""
        return [option(name) for name, value in self.given.items() if value != self.usual.get(name)]

    @property
    def remembered(self) -> dict[str, Any]:
        """The arguments that also suit other files of the same kind: all but the rows. A model file keeps them."""
        return {name: value for name, value in self.given.items() if name != "rows"}

    def of_model(self, path: Path) -> Reader:
        """This reader after the arguments in a model file, see `after`.

        Raises:
            DataError: where neither that file nor an option names the input and the output.
        """
        from emsid.io import origin, read_options

        source = origin(path)
        found = self.after(read_options(path), () if source is None else source.names)
        if "input" not in found.given or "output" not in found.given:
            raise DataError(
                f"{path}: the file does not say how its record was read; give the columns of input and output",
                arguments=("input", "output"),
            )
        return found

    def after(self, remembered: Mapping[str, Any] | None, channels: Collection[str] = ()) -> Reader:
        """A reader that takes arguments that are not given from a model file.

        Gains, offsets and units are merged column by column, whether a column is named with its unit or without it. An
        option of a column holds for the column in the same place where other inputs or outputs are given. A sample time
        replaces a time column, and vice versa. An empty text removes an argument of the file.

        Args:
            remembered: arguments of `emsid.io.read` in the model file.
            channels: the names of the channels of the model there.
        """
        from emsid.units import called, column_of

        before = dict(remembered or {})
        moved = {
            column_of(old): column_of(new)
            for side in ("input", "output")
            if len(self.given.get(side, ())) == len(before.get(side, ()))
            for old, new in zip(before.get(side, ()), self.given.get(side, ()), strict=True)
        }

        def in_place(name: str) -> str:
            """The name of the column that is given in the place of another."""
            column = column_of(name)
            new = next((moved[old] for old in moved if called(column, {old: ""}) or called(old, {column: ""})), column)
            return name.replace(column, new)

        before |= {
            name: {in_place(column): each for column, each in value.items()}
            for name, value in before.items()
            if isinstance(value, Mapping)
        }
        if "dt" in self.given and "time" not in self.given:
            before = {name: value for name, value in before.items() if name not in ("time", "time_unit", "resample")}
        elif "time" in self.given:
            before = {name: value for name, value in before.items() if name not in ("dt", "time_unit")}

        def with_others(name: str, given: dict[str, Any]) -> dict[str, Any]:
            kept = {
                column: value
                for column, value in before.get(name, {}).items()
                if not any(called(each, {column: ""}) or called(column, {each: ""}) for each in given)
            }
            return {**kept, **given}

        merged = {
            name: with_others(name, value) if isinstance(value, dict) else value for name, value in self.given.items()
        }
        recalled = "dt" in before and not {"dt", "time"} & set(self.given)
        return Reader(
            {name: value for name, value in (before | merged).items() if value not in ("", [])},
            {},
            recalled,
            frozenset(set(before.get("units", {})) - set(self.given.get("units", {}))),
            frozenset(map(column_of, channels)),
        )


def _kind_in_words(path: Path, dbc: str | None) -> str:
    """What a file is, where that is no dynamic record, as the beginning of a message."""
    from emsid.first_look import describe
    from emsid.first_look.kinds import FileKind

    with suppress(EmsidError):
        look = describe(path, dbc=dbc)
        return "" if look.kind.kind is FileKind.DYNAMIC else f"{look.name} is {look.kind}; "
    return ""


def _certain_columns(
    files: Sequence[Path], given: Mapping[str, Any]
) -> tuple[dict[str, Any] | None, list[Path], list[str]]:
    """The arguments of `emsid.io.read` that a first look is almost certain of, the files, and what to say about it.

    Where it is not certain, there are no arguments, and a line for each of the best hypotheses.

    Raises:
        FormatError: where a file cannot be read.
    """
    from emsid.first_look.together import hypotheses

    found, sure = hypotheses(files, given)
    if sure:
        best = found[0]
        sides = {side: [best.reading[side]] for side in ("input", "output")}
        said = f"a first look is almost certain of the columns; this is the same: {command_line(identify_words(best))}"
        return {**best.reading, **sides}, [Path(look.path) for look in best.looks], [said]
    lines = []
    for each in found:
        left = f"a simple response leaves {100 * each.left:.2g} % of the output's variance"
        lines.append(f"{left if each.left < 1 else 'no simple response is seen'}: {command_line(identify_words(each))}")
    return None, [], lines


def identify_words(group: Hypothesis | Group) -> list[str]:
    """The words of the command that identifies from files as a first look reads them."""
    files = [file_word(look.path) for look in group.looks]
    return ["emsid", "identify", *files, *as_options(group.reading), *as_options(group.fit)]


def as_options(reading: Mapping[str, Any]) -> list[str]:
    """The words of a command line that give these arguments of `emsid.io.read`.

    >>> as_options({"input": "u", "dt": 0.01, "units": {"y": "rpm"}, "resample": True, "rows": slice(2, None)})
    ['--input', 'u', '--dt', '0.01', '--unit', 'y=rpm', '--resample', '--rows', '2:']
    """
    words: list[str] = []
    for name, value in reading.items():
        if value is True:
            words.append(option(name))
        elif isinstance(value, Mapping):
            for column, each in value.items():
                words += [option(name), f"{column}={_as_text(each)}"]
        elif isinstance(value, slice):
            ends = ("" if end is None else str(end) for end in (value.start, value.stop))
            words += [option(name), ":".join(ends)]
        elif value is not None and value is not False:
            several = value if isinstance(value, (list, tuple)) else [value]
            for each in several:
                words += [option(name), _as_text(each)]
    return words


def _as_text(value: object) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def reads_records(**defaults: Any) -> Callable[[Command], Command]:
    """Add the options of `emsid.read` to a command; its argument ``reader`` is the `Reader` made from them.

    Args:
        defaults: values of options that are not given.
    """
    return takes(READING, "reader", lambda given: Reader(given, defaults), **defaults)


def command_line(words: Iterable[str]) -> str:
    r"""Words of a command as one line, which a shell divides into the same words.

    >>> print(command_line(["emsid", "describe", "my log.csv"]), command_line(["a\nb"]))
    emsid describe 'my log.csv' $'a\nb'
    """
    return " ".join(_quoted(word) for word in words)


def file_word(path: str) -> str:
    """The path of a file as a word of a command line, which is not taken for an option.

    >>> file_word("-x.csv"), file_word("x.csv")
    ('./-x.csv', 'x.csv')
    """
    return f"./{path}" if path.startswith("-") else path


_ESCAPES = {"\n": r"\n", "\r": r"\r", "\t": r"\t", "\\": r"\\", "'": r"\'"}


def _quoted(word: str) -> str:
    if word.isprintable():
        return shlex.quote(word)
    return f"$'{''.join(map(_escaped, word))}'"


def _escaped(sign: str) -> str:
    if sign in _ESCAPES:
        return _ESCAPES[sign]
    if sign.isprintable():
        return sign
    return "".join(f"\\{byte:03o}" for byte in os.fsencode(sign))
