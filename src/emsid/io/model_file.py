"""Model files: JSON with its format, the version of its schema, and a checksum.

::

    {"format": "emsid model", "schema": 4, "type": "narx", "model": {…}, "sha256": "…", "origin": {…}, "reading": {…},
     "fit": {…}}

========  =============================================================================================================
format    ``emsid model``
schema    version of this layout, a whole number
type      kind of model, a key of `emsid.models.kinds.MODELS`
model     what the ``to_data`` of that kind gives
sha256    checksum of all other entries with their keys sorted and no blanks: a file may be laid out anew, not altered
origin    may be missing: ``dt`` in s, ``inputs`` and ``outputs`` as [name, unit] of what the model was identified from,
          and a ``fingerprint`` in base 64 that shows whether a record contains some of these data
reading   may be missing: how the file of that record was read, the arguments of `emsid.io.read` but path and rows
fit       may be missing: estimates, covariance, units and findings of the fit, see below
========  =============================================================================================================

Schema 1 had no ``reading``, schema 2 no ``fit``, and schema 3 no status of an estimate that depends on assumed values,
which is found from the rows of its table when it is read. All are still read.
What a kind of model has added to its data since then is optional there.
Floats are written with enough digits to be read back exactly.

**The entry** ``fit``. Numbers that JSON cannot hold, as the infinite variance of a parameter that the data do not
determine, are texts. Of the covariance, which is symmetric, the rows of the lower triangle are written; of more than
`MOST_SHARED` parameters the variances only, and what is read back has NaN beside them.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, get_type_hints

import msgspec
from msgspec.structs import asdict

from emsid.errors import EmsidError, FormatError, ModelError, listed
from emsid.estimation.fit import Fit
from emsid.findings import Finding
from emsid.io.files import atomic_write, indented_json, read_bytes
from emsid.io.limits import check_limits
from emsid.record.channels import ChannelNames
from emsid.record.holding_back import fingerprint, has_fingerprint
from emsid.units import channel_and_unit

if TYPE_CHECKING:
    from emsid.models.model import Model
    from emsid.record import Record


from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.estimates import Estimate, Status, assumed_in
from emsid.estimation.fit import Ending
from emsid.io.limits import LARGEST

if TYPE_CHECKING:
    from emsid.models.model import Model

FORMAT = "emsid model"
SCHEMA = 4
READABLE = (1, 2, 3, 4)
"""The schemas that this version reads."""
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")  # all but tab and line feed
SAME_DT = 1e-3
"""Sample times with a smaller relative difference are treated as equal."""


class _Head(msgspec.Struct):
    """The two entries that every version has."""

    format: str
    schema: int


class Origin(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The channels and sample time of the record that a model was identified from, as `ChannelNames`.

    Attributes:
        dt: sample time in seconds.
        inputs, outputs: name and unit of every channel.
        fingerprint: shows whether a record contains some of that record, see `emsid.record.holding_back`.
    """

    dt: float
    inputs: tuple[tuple[str, str], ...]
    outputs: tuple[tuple[str, str], ...]
    fingerprint: bytes = b""

    @classmethod
    def of(cls, record: Record) -> Origin:
        """The channels and the fingerprint of a record."""
        known = ChannelNames.of(record)
        return cls(known.dt, known.inputs, known.outputs, fingerprint(record))

    @classmethod
    def named(cls, channels: ChannelNames) -> Origin:
        """The same without data, which have a fingerprint."""
        return cls(channels.dt, channels.inputs, channels.outputs)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of inputs and outputs."""
        return tuple(name for name, _ in (*self.inputs, *self.outputs))

    @property
    def channels(self) -> ChannelNames:
        """The channels without the fingerprint."""
        return ChannelNames(self.dt, self.inputs, self.outputs)

    def seen(self, record: Record) -> bool:
        """Whether a record contains data that the model was fitted to."""
        return has_fingerprint(record, self.fingerprint)

    def differences(self, record: Record) -> list[Finding]:
        """The differences between a record and the record that the model was identified from.

        Outputs are not compared where the record has none. Channels are the same if names and units are, wherever the
        unit is written.
        """
        other, found = Origin.of(record), []
        for what in ("inputs", *(("outputs",) if record.output_names else ())):
            mine, theirs = getattr(self, what), getattr(other, what)
            if [channel_and_unit(*each) for each in mine] != [channel_and_unit(*each) for each in theirs]:
                data = {"what": what, "identified_with": _channels(mine), "channels": _channels(theirs)}
                found.append(Finding("channels-differ", record.name, data))
        if abs(other.dt - self.dt) > SAME_DT * self.dt:
            times = {"identified_with": self.dt, "dt": other.dt}
            found.append(Finding("sample-time-differs", record.name, times))
        return found


class _Document(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    format: str
    schema: int
    type: str
    model: dict[str, Any]
    sha256: str
    origin: Origin | None = None
    reading: dict[str, Any] | None = None
    fit: FitData | None = None


def save(
    model: Model | Fit[Any],
    path: str | os.PathLike[str],
    origin: Record | None = None,
    reading: Mapping[str, Any] | None = None,
) -> None:
    """Write a model, or a fit with its table, to a file, from which `load` reads it back exactly.

    Args:
        model: the model, or a fit: then estimates, covariance, units and findings are in the file too.
        path: the file.
        origin: the record that it was identified from; its channels, sample time and fingerprint are written. By
            default the channels that the fit knows.
        reading: arguments of `emsid.io.read` with which that record was read, to read other files in the same way.

    Raises:
        ModelError: for a model whose type has no name in `MODELS`, with a number that is not finite, or
            with control characters in a text.
        FormatError: where the file cannot be written.
    """
    from emsid.models.kinds import MODELS

    found = model if isinstance(model, Fit) else None
    model = model if found is None else found.model
    name = next((name for name, kind in MODELS.items() if kind is type(model)), None)
    if name is None:
        raise ModelError(f"a {type(model).__name__} cannot be saved; models are {', '.join(MODELS)}")
    data = model.to_data()
    _check_finite(data, "model")
    _check_texts(data)
    check_limits(data, "the model")
    known = None if found is None or found.channels is None else Origin.named(found.channels)
    source = known if origin is None else Origin.of(origin)
    how = dict(reading) if reading else None
    estimated = None if found is None or not (found.names or found.table) else fit_data(found)
    _check_texts(msgspec.to_builtins(estimated))
    document = _Document(FORMAT, SCHEMA, name, data, "", source, how, estimated)
    document.sha256 = _checksum(document)
    atomic_write(path, indented_json(document))


def load(path: str | os.PathLike[str]) -> Model | Fit[Any]:
    """Read what `save` wrote: a fit with its table of parameters, or a model; a fit has all that its model has.

    Args:
        path: the file.

    Raises:
        FormatError: where the file cannot be read, is no model file, is of another version, has been altered, or
            describes no possible model.
    """
    document = _read(path)
    model = _model(path, document)
    if document.fit is None:
        return model
    try:
        _check_texts(msgspec.to_builtins(document.fit))
        return fit_of(model, document.fit, None if document.origin is None else document.origin.channels)
    except (EmsidError, ValueError) as problem:
        raise FormatError(f"{path}: {problem}; identify the model again") from None


def load_model(path: str | os.PathLike[str]) -> Model:
    """Read a model alone from a file, without the table of its fit.

    Raises:
        FormatError: as `load` does.
    """
    return _model(path, _read(path))


def _model(path: str | os.PathLike[str], document: _Document) -> Model:
    from emsid.models.kinds import MODELS

    if document.type not in MODELS:
        raise FormatError(f"{path}: unknown type of model {document.type!r}; there are {', '.join(MODELS)}")
    try:
        _check_texts(document.model)
        return MODELS[document.type].from_data(document.model)
    except EmsidError as problem:
        raise FormatError(f"{path}: {problem}") from None
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError) as problem:
        # The classes of models check for common mistakes; a tampered file may raise any exception.
        raise FormatError(
            f"{path}: the file contains an impossible model ({type(problem).__name__}); identify it again"
        ) from None


def origin(path: str | os.PathLike[str]) -> Origin | None:
    """Channels and sample time of the record that a model was identified from; None where the file has none.

    Raises:
        FormatError: as `load` does.
    """
    return _read(path).origin


def read_options(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Arguments of `emsid.io.read` with which the record was read that a model was identified from.

    Raises:
        FormatError: as `load` does.
    """
    return _read(path).reading or {}


def _read(path: str | os.PathLike[str]) -> _Document:
    """Read a model file; it must be complete, of a readable version and not altered."""
    content = read_bytes(path, "save the model again")
    try:
        text = content.decode()
        head = msgspec.json.decode(text, type=_Head)
    except (msgspec.MsgspecError, RecursionError, ValueError) as problem:
        raise FormatError(
            f"{path}: this is not a model file, or is cut off ({_visible(str(problem))}); save the model again"
        ) from None
    if head.format != FORMAT:
        raise FormatError(f"{path}: this is a {head.format!r} file, not an {FORMAT!r}; name a file that emsid saved")
    if head.schema not in READABLE:
        raise FormatError(
            f"{path}: the model is written in schema {head.schema} and this version of emsid reads "
            f"{listed([str(schema) for schema in READABLE])}; use the version that wrote it, or identify it again"
        )
    try:
        document = msgspec.json.decode(text, type=_Document)
        check_limits([document.model, document.origin and asdict(document.origin), document.reading], "the model file")
        check_limits(msgspec.to_builtins(document.fit), "the fit in the model file")
        _check_reading(document.reading or {})
    except EmsidError as problem:
        raise FormatError(f"{path}: {problem}") from None
    except (msgspec.MsgspecError, RecursionError, ValueError) as problem:
        raise FormatError(
            f"{path}: the model file is not complete ({_visible(str(problem))}); save the model again"
        ) from None
    if document.sha256 != _checksum(document):
        raise FormatError(
            f"{path}: the model has been altered since it was saved (its checksum differs); restore the file, or "
            "identify the model again"
        )
    return document


def _check_reading(reading: Mapping[str, Any]) -> None:
    """Refuse arguments that `emsid.io.read` does not have, and values of another type.

    Raises:
        ModelError: with the argument.
        msgspec.ValidationError: with the type.
    """
    from emsid.io.reading import read

    types = {name: kind for name, kind in get_type_hints(read).items() if name not in ("path", "rows", "return")}
    for name, value in reading.items():
        if name not in types:
            raise ModelError(f"the file says that its record was read with {name!r:.80}, which is no argument of read")
        msgspec.convert(value, types[name])


def _channels(channels: tuple[tuple[str, str], ...]) -> list[dict[str, str]]:
    """The channels as the data of a finding."""
    return [{"name": name, "unit": unit} for name, unit in channels]


def _visible(text: str) -> str:
    return _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def _checksum(document: _Document) -> str:
    content = {name: value for name, value in msgspec.to_builtins(document).items() if name != "sha256"}
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def _check_texts(value: object) -> None:
    """Refuse texts with control characters, which could affect a terminal."""
    if isinstance(value, str) and _CONTROL.search(value):
        raise ModelError(f"the text {value[:80]!a} in the model has control characters in it; give it another name")
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _check_texts(key)
            _check_texts(inner)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for inner in value:
            _check_texts(inner)


def _check_finite(value: object, where: str) -> None:
    """Refuse numbers that JSON cannot hold; ``where`` names the value in the message."""
    if isinstance(value, float) and not isfinite(value):
        raise ModelError(f"{where} is {value}; only a model with finite numbers can be saved")
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _check_finite(inner, f"{where}.{key}")
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for k, inner in enumerate(value):
            _check_finite(inner, f"{where}[{k}]")


Array = NDArray[np.float64]
# --- the entry of a fit -----------------------------------------------------------------------------------------------

Number = float | str

MOST_SHARED = 250
"""With the triangle of more parameters, a file comes near `emsid.io.limits.MOST_ENTRIES`."""


class Row(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A row of the table of parameters."""

    name: str
    value: Number
    status: Status
    symbol: str = ""
    unit: str = ""
    description: str = ""
    standard_error: Number | None = None
    start: Number | None = None
    datasheet: Number | None = None
    given: tuple[str, ...] = ()
    interval: tuple[Number, Number] | None = None
    record: str = ""


class Found(msgspec.Struct, forbid_unknown_fields=True):
    """A finding."""

    code: str
    subject: str
    data: dict[str, Any]


class FitData(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """What a fit is besides its model."""

    names: tuple[str, ...]
    estimate: list[Number]
    covariance: list[list[Number]]
    noise_variance: Number
    samples: Number
    condition: Number
    rank: int
    ending: Ending
    method: str
    iterations: int = 0
    dependent: int = 0
    table: tuple[Row, ...] = ()
    findings: tuple[Found, ...] = ()
    output_noise: list[Number] = msgspec.field(default_factory=list)


def fit_data(fit: Fit[Any]) -> FitData:
    """A fit without its model, its history and its channels."""
    size = len(fit.names)
    lower = [row[: k + 1] if size <= MOST_SHARED else row[k : k + 1] for k, row in enumerate(fit.covariance.tolist())]
    return FitData(
        names=tuple(fit.names),
        estimate=_written(fit.estimate.tolist()),
        covariance=[_written(row) for row in lower],
        noise_variance=_number(fit.noise_variance),
        samples=_number(fit.samples),
        condition=_number(fit.condition),
        rank=int(fit.rank),
        ending=fit.ending,
        method=fit.method,
        iterations=int(fit.iterations),
        dependent=int(fit.dependent),
        table=tuple(_row(row) for row in fit.table),
        findings=tuple(_finding(finding) for finding in fit.findings if _fits(finding)),
        output_noise=[] if fit.output_noise is None else _written(fit.output_noise.tolist()),
    )


def fit_of(model: Model, data: FitData, channels: ChannelNames | None) -> Fit[Any]:
    """The fit that was written with its model.

    Raises:
        ModelError: for data of another form.
    """
    size = len(data.names)
    sizes = [len(row) for row in data.covariance]
    if len(data.estimate) != size or sizes not in ([k + 1 for k in range(size)], [1] * size):
        raise ModelError(f"a fit of {size} parameters with {len(data.estimate)} estimates and another covariance")
    covariance = np.full((size, size), np.nan)
    for k, row in enumerate(data.covariance):
        covariance[k, k + 1 - len(row) : k + 1] = covariance[k + 1 - len(row) : k + 1, k] = _numbers(row)
    if (np.diag(covariance) < 0).any():
        raise ModelError("the variance of an estimate is negative")
    findings = tuple(Finding(finding.code, finding.subject, finding.data) for finding in data.findings)
    return Fit(
        model,
        data.names,
        _numbers(data.estimate),
        covariance,
        float(data.noise_variance),
        float(data.samples),
        float(data.condition),
        data.rank,
        data.ending,
        data.method,
        data.iterations,
        findings=findings,
        dependent=data.dependent,
        table=_with_assumptions([_estimate(row) for row in data.table]),
        channels=channels,
        output_noise=_numbers(data.output_noise) if data.output_noise else None,
    )


def _number(value: float) -> Number:
    return float(value) if isfinite(value) and abs(value) <= LARGEST else repr(float(value))


def _written(values: Sequence[float]) -> list[Number]:
    return [_number(value) for value in values]


def _numbers(values: Sequence[Number]) -> Array:
    return np.array([float(value) for value in values])


def _row(row: Estimate) -> Row:
    numbers = {name: getattr(row, name) for name in ("standard_error", "start", "datasheet")}
    return Row(
        row.name,
        _number(row.value),
        Status(row.status),
        row.symbol,
        row.unit,
        row.description,
        given=tuple(row.given),
        interval=None if row.interval is None else (_number(row.interval[0]), _number(row.interval[1])),
        record=row.record,
        **{name: None if value is None else _number(value) for name, value in numbers.items()},
    )


def _estimate(row: Row) -> Estimate:
    numbers = {name: getattr(row, name) for name in ("standard_error", "start", "datasheet")}
    return Estimate(
        row.name,
        row.symbol,
        row.unit,
        row.description,
        float(row.value),
        status=row.status,
        given=row.given,
        interval=None if row.interval is None else (float(row.interval[0]), float(row.interval[1])),
        record=row.record,
        **{name: None if value is None else float(value) for name, value in numbers.items()},
    )


def _with_assumptions(table: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """The rows, of which older files call every one that depends on a value that was held conditional."""
    nobodys = {row.name for row in assumed_in(table)}
    return tuple(
        replace(row, status=Status.ASSUMING)
        if row.status is Status.CONDITIONAL and nobodys.intersection(row.given)
        else row
        for row in table
    )


def _finding(finding: Finding) -> Found:
    return Found(finding.code, finding.subject, msgspec.to_builtins(dict(finding.data)))


def _fits(finding: Finding) -> bool:
    """Whether a finding has numbers and texts that a file can hold; others are left out."""
    try:
        check_limits([finding.subject, msgspec.to_builtins(dict(finding.data))])
    except (ModelError, TypeError):
        return False
    return True
