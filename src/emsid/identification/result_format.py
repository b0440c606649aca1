"""The format of ``result.json``: its schema, and the version of it.

Every table below is an object of the file; ``docs/result-format.md`` explains it, and ``docs/result.schema.json`` is
the same as a JSON Schema. A number that is infinite or not a number is written as null. A change that a reader of the
file would notice raises `VERSION`.
"""

from __future__ import annotations

from typing import Any

import msgspec

from emsid.errors import FormatError

FORMAT, VERSION = "emsid result", 5

Number = float | None


class FindingData(msgspec.Struct, forbid_unknown_fields=True):
    """One thing that was noticed; ``emsid.wording`` has its sentence."""

    code: str
    subject: str
    data: dict[str, Any]


class ParameterData(msgspec.Struct, forbid_unknown_fields=True):
    """A parameter; ``interval`` is its 95 % interval, null where it was not estimated or is not determined.

    ``given`` names the fixed and kept values that it depends on; the interval holds only if these are right. A
    parameter that differs by record has the name of its ``record``.
    """

    name: str
    unit: str
    value: Number
    standard_error: Number
    interval: tuple[Number, Number] | None
    status: str
    symbol: str = ""
    description: str = ""
    start: Number = None
    datasheet: Number = None
    given: list[str] = []
    record: str = ""


class CombinationData(msgspec.Struct, forbid_unknown_fields=True):
    """A combination of parameters that the data determine; ``given`` as in `ParameterData`."""

    name: str
    formula: str
    unit: str
    value: Number
    standard_error: Number
    interval: tuple[Number, Number] | None
    parameters: list[str]
    given: list[str] = []
    shown: bool = True


class FitData(msgspec.Struct, forbid_unknown_fields=True):
    """A fitted model: what `Fit.to_data` gives; ``assumed`` names values that nobody gave and estimates depend on."""

    model: str
    method: str
    ending: str
    iterations: int
    samples: Number
    noise_variance: Number
    condition: Number
    rank: int
    parameters: list[ParameterData]
    findings: list[FindingData]
    combinations: list[CombinationData] = []
    assumed: list[str] = []


class OutputData(msgspec.Struct, forbid_unknown_fields=True):
    """The errors of one output of several."""

    output: str
    unit: str
    one_step_mse: Number
    simulation_mse: Number
    simulation_rmse: Number
    fit_percent: Number


class RowData(msgspec.Struct, forbid_unknown_fields=True):
    """The errors of a model.

    ``data`` is ``identification`` (the data it was fitted to), ``choice`` (unseen data that chose among the models) or
    ``unseen``; without ``choice`` the rows of ``unseen`` chose.
    """

    experiment: str
    model: str
    method: str
    data: str
    one_step_mse: Number
    simulation_mse: Number
    simulation_rmse: Number
    fit_percent: Number
    parameters: int
    samples: int
    diverged_at: int | None = None
    outputs: list[OutputData] = []


class FrontData(msgspec.Struct, forbid_unknown_fields=True):
    """A model in the comparison of accuracy and number of parameters, on ``folds`` parts of the data.

    ``error`` is the RMSE of the free run as a share of the output's deviation, ``low`` and ``high`` one standard error
    away. A model ``on_front`` is better by more than noise than every simpler one on the front.
    """

    model: str
    parameters: int
    error: Number
    low: Number
    high: Number
    folds: int
    on_front: bool
    recommended: bool


class RegionData(msgspec.Struct, forbid_unknown_fields=True):
    """The error of a model on unseen data in one operating region of an output.

    ``region`` is ``standstill``, ``low speed``, ``reversal`` or ``high speed``; their limits
    are in `emsid.validation.comparison`. ``share`` is that of the squared error.
    """

    model: str
    output: str
    unit: str
    region: str
    samples: int
    rmse: Number
    share: Number


class RecordData(msgspec.Struct, forbid_unknown_fields=True):
    """The error of a model on one of several records as a whole, used in the fit or not."""

    model: str
    record: str
    output: str
    unit: str
    samples: int
    rmse: Number


class ProfileData(msgspec.Struct, forbid_unknown_fields=True):
    """The likelihood profile of a parameter; an end of the interval that was not found is null."""

    model: str
    name: str
    unit: str
    estimate: Number
    standard_error: Number
    level: float
    values: list[Number]
    deviance: list[Number]
    interval: tuple[Number, Number]


class CharacteristicData(msgspec.Struct, forbid_unknown_fields=True):
    """Gain, time constant, dead zone or friction; ``half_width`` of the 95 % interval; no numbers if not ``shown``."""

    name: str
    value: Number
    half_width: Number
    unit: str
    model: str
    shown: bool = True
    given: list[str] = []


class CurveData(msgspec.Struct, forbid_unknown_fields=True):
    """A curve of the recommended model with its 95 % band; ``low`` and ``high`` are null without intervals.

    ``kind`` is ``step response``, ``magnitude`` or ``phase`` (of the frequency response), ``static map``, ``map in
    feedback``, ``friction`` or ``dead zone``.
    """

    model: str
    kind: str
    x_name: str
    x_unit: str
    name: str
    unit: str
    input: str
    output: str
    x: list[Number]
    value: list[Number]
    low: list[Number]
    high: list[Number]
    level: float


class ResultFile(msgspec.Struct, forbid_unknown_fields=True):
    """All of ``result.json``."""

    format: str
    version: int
    interrupted: bool
    chosen: str
    rows: list[RowData]
    front: list[FrontData]
    regions: list[RegionData]
    records: list[RecordData]
    fits: list[FitData]
    profiles: list[ProfileData]
    findings: list[FindingData]
    characteristics: list[CharacteristicData]
    curves: list[CurveData]
    recommendation: list[FindingData]
    verdicts: list[FindingData]
    residual: list[FindingData]
    next: list[FindingData]


def checked(content: Any) -> ResultFile:
    """The content of a ``result.json``, checked.

    Raises:
        FormatError: where it is not of this format and version.
    """
    found = (content.get("format"), content.get("version")) if isinstance(content, dict) else (None, None)
    if found != (FORMAT, VERSION):
        raise FormatError(f"not a result that this emsid reads: {found[0]!r} version {found[1]!r}; identify again")
    try:
        return msgspec.convert(content, ResultFile)
    except msgspec.ValidationError as problem:
        raise FormatError(f"not a valid result: {problem}; identify again") from problem


def schema() -> dict[str, Any]:
    """The format as a JSON Schema."""
    return msgspec.json.schema(ResultFile)
