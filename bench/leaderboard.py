"""The default of ``emsid identify`` on public benchmarks: ``python bench/leaderboard.py DIR``.

No data are part of the program. Download the files of https://www.nonlinearbenchmark.org, and put them anywhere below
DIR under their own names. A file is taken by its name; where its SHA-256 is known here, a file with another one is left
out. Of a set without its official file, a part that is there is used, and the row says that the protocols differ.

Protocol: default options; only the estimation part is given, of which the program itself holds a part back; the model
that it recommends is run freely over the test part, from the initial state that the first samples give, as many as the
benchmark allows or as the model needs; they are left out of the error. Where the model needs more samples than the
benchmark allows, the row says so. ``--budget 600`` limits the seconds of the searches of a set.

The table is printed as Markdown; ``docs/accuracy.md`` holds it.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import emsid
from arguments import parser_of
from emsid.models.free_run import free_run

Parts = tuple[Sequence[emsid.Record], Sequence[emsid.Record]]


@dataclass(frozen=True)
class Benchmark:
    """A public benchmark.

    Attributes:
        name: in the table; several may read the same files.
        files: names of the files that are needed.
        parts: from their paths to the records of the estimation part and of the test part.
        allowed: samples that may give the initial state.
        unit, scale: of the error in the table.
        published: the error that was published, in this unit, and its source.
        equal: why the published error holds for the same protocol, or what differs: empty where it is the same.
        sha256: of the files where they are known.
    """

    name: str
    files: tuple[str, ...]
    parts: Callable[[Sequence[Path]], Parts]
    allowed: int
    unit: str
    scale: float = 1.0
    published: str = "–"
    differs: str = ""
    sha256: tuple[str, ...] = ()


def variables(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a MAT file, without its singleton axes."""
    from scipy.io import loadmat

    return {name: np.squeeze(value) for name, value in loadmat(path).items() if not name.startswith("__")}


def wiener_hammerstein(paths: Sequence[Path]) -> Parts:
    """The official window of 100,000 samples, and those after it."""
    data = variables(paths[0])
    whole = emsid.Record(data["uBenchMark"], data["yBenchMark"], 1 / float(data["fs"]))[5200:184_000]
    return [whole[:100_000]], [whole[100_000:]]


def first_of_wiener_hammerstein(paths: Sequence[Path]) -> Parts:
    whole = emsid.read(paths[0], input="u", output="y", dt=1 / 51_200, rows=slice(5200, None))
    return [whole[:79_800]], [whole[79_800:]]


def silverbox(test: slice) -> Callable[[Sequence[Path]], Parts]:
    """Three quarters of the multisines, and the rest of them or the arrow."""

    def parts(paths: Sequence[Path]) -> Parts:
        data = variables(paths[0])
        whole = emsid.Record(data["V1"], data["V2"], 1 / 610.35)
        return [whole[40_650:105_712]], [whole[test]]

    return parts


def drives(pair: int) -> Callable[[Sequence[Path]], Parts]:
    def parts(paths: Sequence[Path]) -> Parts:
        data = variables(paths[0])
        whole = emsid.Record(data[f"u1{pair}"], data[f"z1{pair}"], 0.02)
        return [whole[:400]], [whole[400:]]

    return parts


def first_of_drives(pair: int) -> Callable[[Sequence[Path]], Parts]:
    def parts(paths: Sequence[Path]) -> Parts:
        whole = emsid.read(paths[0], input=f"u1{pair}", output=f"z1{pair}", dt=0.02)
        return [whole[:300]], [whole[300:]]

    return parts


def tanks(paths: Sequence[Path]) -> Parts:
    data = variables(paths[0])
    dt = float(data["Ts"])
    return [emsid.Record(data["uEst"], data["yEst"], dt)], [emsid.Record(data["uVal"], data["yVal"], dt)]


def emps(paths: Sequence[Path]) -> Parts:
    """The force that drives the axis, and its position."""

    def record(path: Path) -> emsid.Record:
        data = variables(path)
        force = data["vir"] * float(data["gtau"])
        return emsid.Record(
            force, data["qm"], float(data["t"][1] - data["t"][0]), ("force",), ("position",), ("N",), ("m",)
        )

    whole = record(paths[0])
    if len(paths) > 1:
        return [whole], [record(paths[1])]
    return [whole[: int(0.7 * len(whole))]], [whole[int(0.7 * len(whole)) :]]


def bouc_wen(paths: Sequence[Path]) -> Parts:
    """Records that users simulate by the given program, as fit.csv, and the official test files."""
    fitted = emsid.read(paths[0], input="u", output="y", dt=1 / 750)
    test = [variables(path) for path in paths[1:]]
    u, y = (next(iter(data.values())) for data in test)
    return [fitted], [emsid.Record(u, y, 1 / 750)]


def ground_vibration(level: int) -> Callable[[Sequence[Path]], Parts]:
    """Multisines of an aircraft at one level, three accelerations over the force."""

    def parts(paths: Sequence[Path]) -> Parts:
        def record(path: Path) -> emsid.Record:
            data = variables(path)
            return emsid.Record(data["Force"].ravel(), np.atleast_2d(data["Acceleration"]).reshape(3, -1).T, 1 / 400)

        return [record(paths[0])], [record(paths[1])]

    return parts


def parallel(paths: Sequence[Path]) -> Parts:
    """Realisations of multisines at the highest amplitude: those for estimation, the last for the test."""
    data = variables(paths[0])
    dt, u, y = 1 / float(data["fs"]), data["uEst"], data["yEst"]
    several = [emsid.Record(one, other, dt) for one, other in zip(np.atleast_2d(u.T), np.atleast_2d(y.T), strict=True)]
    return several[:-1], several[-1:]


def robot(paths: Sequence[Path]) -> Parts:
    """Six torques and six angles."""
    data = variables(paths[0])
    dt = float(np.ravel(data["time_train"])[1] - np.ravel(data["time_train"])[0])
    return (
        [emsid.Record(data["u_train"].T, data["y_train"].T, dt)],
        [emsid.Record(data["u_test"].T, data["y_test"].T, dt)],
    )


def process_noise(paths: Sequence[Path]) -> Parts:
    """A circuit with noise before its nonlinearity: multisines for estimation, another for the test."""
    fitted, test = (variables(path)["dataMeas"] if "dataMeas" in variables(path) else variables(path) for path in paths)
    records = [emsid.Record(np.ravel(each["u"][()]), np.ravel(each["y"][()]), 1 / 78_125) for each in (fitted, test)]
    return records[:1], records[1:]


PART = "other part of the data"
BENCHMARKS = (
    Benchmark(
        "Wiener–Hammerstein 2009",
        ("WienerHammerBenchMark.mat",),
        wiener_hammerstein,
        50,
        "mV",
        1e3,
        "0.241 (deep encoder; Beintema et al. 2023)",
    ),
    Benchmark(
        "Wiener–Hammerstein 2009, first part",
        ("estimation.csv",),
        first_of_wiener_hammerstein,
        50,
        "mV",
        1e3,
        "0.241 (deep encoder; Beintema et al. 2023)",
        f"{PART}: the last 20,200 of the first 100,000 samples",
        ("090a4860e95be94b5da7db5e3a3defc084a87a41b2b95b7e244bd977ccea2bba",),
    ),
    Benchmark("Silverbox, multisine", ("SNLS80mV.mat",), silverbox(slice(105_712, 127_400)), 50, "mV", 1e3),
    Benchmark(
        "Silverbox, arrow",
        ("SNLS80mV.mat",),
        silverbox(slice(100, 40_575)),
        50,
        "mV",
        1e3,
        "0.26 (polynomial state space; Paduart 2008)",
        "other division of the multisines",
    ),
    *(
        Benchmark(f"coupled drives, {level} amplitude", ("DATAUNIF.MAT",), drives(k), 4, "ticks/s", 1.0, published)
        for k, level, published in ((1, "low", "0.045 (LSTM)"), (2, "high", "0.061 (LSTM)"))
    ),
    *(
        Benchmark(
            f"coupled drives, {level} amplitude, first part",
            ("uniform_first400.csv",),
            first_of_drives(k),
            4,
            "ticks/s",
            1.0,
            published,
            f"{PART}: samples 300 to 400",
            ("0a6770ec78c6815e98cdbd7466a8cc3a74db4fbbf2a54b3869706f3db4a79b55",),
        )
        for k, level, published in ((1, "low", "0.045 (LSTM)"), (2, "high", "0.061 (LSTM)"))
    ),
    Benchmark(
        "cascaded tanks", ("dataBenchmark.mat",), tanks, 5, "V", 1.0, "0.34 (nonlinear state space; Relan et al. 2017)"
    ),
    Benchmark(
        "EMPS",
        ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"),
        emps,
        20,
        "mm",
        1e3,
        sha256=("6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",),
    ),
    Benchmark(
        "EMPS, first file",
        ("DATA_EMPS.mat",),
        emps,
        20,
        "mm",
        1e3,
        differs=f"{PART}: its last 30 %",
        sha256=("6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",),
    ),
    Benchmark(
        "process noise", ("WH_CombinedZeroMultisineSinesweep.mat", "WH_TestDataset.mat"), process_noise, 0, "mV", 1e3
    ),
    Benchmark(
        "Bouc–Wen, multisine",
        ("fit.csv", "uval_multisine.mat", "yval_multisine.mat"),
        bouc_wen,
        0,
        "µm",
        1e6,
        "18.7 (best published)",
        "the records for estimation are yours",
    ),
    Benchmark(
        "Bouc–Wen, sweep",
        ("fit.csv", "uval_sinesweep.mat", "yval_sinesweep.mat"),
        bouc_wen,
        0,
        "µm",
        1e6,
        "–",
        "the records for estimation are yours",
    ),
    *(
        Benchmark(
            f"F-16, multisine level {k}",
            (f"F16Data_FullMSine_Level{k}.mat", f"F16Data_FullMSine_Level{k + 1}_Validation.mat"),
            ground_vibration(k),
            0,
            "m/s²",
        )
        for k in (1, 3, 5)
    ),
    Benchmark("parallel Wiener–Hammerstein", ("ParWHData.mat",), parallel, 0, "mV", 1e3),
    Benchmark("industrial robot", ("forward_identification_without_raw_data.mat",), robot, 0, "deg"),
)


def found_files(folder: Path, benchmark: Benchmark) -> list[Path] | str:
    """The files of a benchmark below a folder, or what is missing."""
    paths = []
    for k, name in enumerate(benchmark.files):
        candidates = sorted(folder.rglob(name))
        if not candidates:
            return f"no {name}"
        known = benchmark.sha256[k] if k < len(benchmark.sha256) else ""
        same = [path for path in candidates if not known or hashlib.sha256(path.read_bytes()).hexdigest() == known]
        if not same:
            return f"{name} is another file than the published one: its SHA-256 differs"
        paths.append(same[0])
    return paths


def rows(folder: Path, asked: Sequence[str], budget: float | None) -> Iterator[tuple[str, ...]]:
    """A row for every benchmark whose files are there."""
    for benchmark in BENCHMARKS:
        if asked and not any(word in benchmark.name for word in asked):
            continue
        paths = found_files(folder, benchmark)
        if isinstance(paths, str):
            print(f"{benchmark.name}: {paths}", file=sys.stderr)
            continue
        fitted, test = benchmark.parts(paths)
        began = time.process_time()
        result = emsid.identify(list(fitted), budget=budget)
        seconds = time.process_time() - began
        model, squares, count, used = result.recommended, 0.0, 0, 0
        for record in test:
            record = emsid.Record(
                record.input, record.output, record.dt, fitted[0].input_names, fitted[0].output_names,
                fitted[0].input_units, fitted[0].output_units,
            ).in_si()  # fmt: skip
            used = max(benchmark.allowed, model.memory)
            run = free_run(model, record, used)
            squares = squares + np.sum((record.output - run.output)[run.counted] ** 2, axis=0)
            count += int(np.count_nonzero(run.counted))
        error = np.sqrt(squares / count) * benchmark.scale
        more = (
            f"first {used} samples give the state, {benchmark.allowed} are allowed" if used > benchmark.allowed else ""
        )
        yield (
            benchmark.name,
            model.name + ("" if result.is_recommended else " (not recommended)"),
            f"{', '.join(f'{each:.3g}' for each in np.atleast_1d(error))} {benchmark.unit}",
            benchmark.published,
            "; ".join(filter(None, (benchmark.differs, more))) or "yes",
            f"{seconds:.0f}",
        )


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("folder", metavar="DIR", type=Path, help="where the files are")
    parser.add_argument("names", nargs="*", metavar="NAME", help="a part of the names of the sets (default: all)")
    parser.add_argument("--budget", type=float, help="seconds of the searches of a set")
    asked = parser.parse_args()
    print("| benchmark | model | RMSE | published | same protocol | CPU s |\n|---|---|---|---|---|---|")
    for row in rows(asked.folder, asked.names, asked.budget):
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
