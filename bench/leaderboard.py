"""The default of ``emsid identify`` on public benchmarks: ``python bench/leaderboard.py DIR``.

No data are part of the program. Download the files of https://www.nonlinearbenchmark.org, and put them anywhere below
DIR under their own names. A file is taken by its name; where its SHA-256 is known here, a file with another one is left
out. Of a set without its official file, a part that is there is used, and the row says that the protocols differ.

Protocol: default options; only the estimation part is given, of which the program itself holds a part back; the model
that it recommends is run freely over the test part, from the initial state that the first samples give, as many as the
benchmark allows or as the model needs; they are left out of the error. Where the model needs more samples than the
benchmark allows, the row says so. ``--budget 600`` limits the seconds of the searches of a set.

The rows are printed as Markdown. ``--page docs/accuracy.md`` also writes them into the table of that page, where those
of other sets stay.
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
        published: the error that was published, in this unit where it names no other, and its source.
        differs: what differs from the protocol of the published error; empty where it is the same.
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
    u, y = (next(iter(variables(path).values())) for path in paths[1:])
    return [fitted], [emsid.Record(u, y, 1 / 750)]


def ground_vibration(paths: Sequence[Path]) -> Parts:
    """Multisines of an aircraft at one level and at the next one: three accelerations over the force."""

    def record(path: Path) -> emsid.Record:
        data = variables(path)
        return emsid.Record(data["Force"], data["Acceleration"].T, 1 / float(data["Fs"]))

    return [record(paths[0])], [record(paths[1])]


def parallel(paths: Sequence[Path]) -> Parts:
    """Realisations of multisines at the largest amplitude, and another: axes are N, period, realisation, amplitude."""
    data = variables(paths[0])

    def records(kind: str) -> list[emsid.Record]:
        u, y = (np.reshape(data[name + kind], (*data["uEst"].shape[:2], -1, data["uEst"].shape[3])) for name in "uy")
        return [
            emsid.Record(u[:, :, k, -1].T.ravel(), y[:, :, k, -1].T.ravel(), 1 / float(data["fs"]))
            for k in range(u.shape[2])
        ]

    return records("Est"), records("Val")


def robot(paths: Sequence[Path]) -> Parts:
    """Six torques and six angles."""
    data = variables(paths[0])
    dt = float(np.median(np.diff(data["time_train"])))
    fitted, test = (emsid.Record(data[f"u_{part}"].T, data[f"y_{part}"].T, dt) for part in ("train", "test"))
    return [fitted], [test]


def process_noise(signal: int) -> Callable[[Sequence[Path]], Parts]:
    """A circuit with noise before its nonlinearity: realisations of a file, and a test signal without this noise."""

    def records(path: Path) -> list[emsid.Record]:
        data = variables(path)["dataMeas"][()]
        u, y = (np.reshape(data[name], (len(data[name]), -1)) for name in "uy")
        dt = 1 / float(np.squeeze(data["fs"]))
        return [emsid.Record(u[:, k], y[:, k], dt) for k in range(u.shape[1])]

    def parts(paths: Sequence[Path]) -> Parts:
        fitted, test = map(records, paths)
        return fitted, test[signal : signal + 1]

    return parts


PART = "other part of the data"
# Each published number was read in the source beside it. Those without a source circulate; without them, ours would
# stand beside weaker ones.
DEEP_ENCODER = "Beintema, Tóth, Schoukens 2021, arXiv 2012.07697, notebook"
DYNONET = "Forgione, Piga 2021, arXiv 2006.02250"
NARX = "SysIdentPy 0.9.0, documentation"
ATTENTION = "Fañanás-Anaya and others 2024, DOI 10.1007/s00521-024-10732-y"
EQUILIBRIUM = "Revay, Wang, Manchester 2021, arXiv 2104.05942, table I"
FEEDBACK = "Floren, Noël, Swevers 2025, arXiv 2503.14409, notebook of freq-statespace"
VOLTERRA = "Kilic, Batselier 2025, arXiv 2511.20457, table 1"
TABLE_OF_TANKS = "Mathematical Problems in Engineering 2021, 6613425, table 2"
CIRCUIT = (
    f"0.241 (deep encoder; {DEEP_ENCODER}), 1.2 (dynoNet, over 87,000 samples; {DYNONET}), "
    f"15.2 (polynomial NARX; {NARX})"
)
AXIS = (
    f"4.61 (deep network, source not found), 2.64 (dynoNet, perhaps on the file for estimation; {DYNONET}, "
    "printed as 2.64e-3 mm)"
)
DRIVES = (
    (1, "low", f"0.045 (LSTM, source not found), 0.103 (polynomial NARX of degree 2), 0.113 (degree 3); {NARX}"),
    (2, "high", f"0.061 (LSTM, source not found), 0.107 (polynomial NARX of degree 2), 0.096 (degree 3); {NARX}"),
)
EMPS = "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e"
BENCHMARKS = (
    Benchmark(
        "Wiener–Hammerstein 2009", ("WienerHammerBenchMark.mat",), wiener_hammerstein, 50, "mV", 1e3, CIRCUIT,
    ),
    Benchmark(
        "Wiener–Hammerstein 2009, first part", ("estimation.csv",), first_of_wiener_hammerstein, 50, "mV", 1e3, CIRCUIT,
        f"{PART}: the last 20,200 of the 100,000 samples for estimation",
        ("090a4860e95be94b5da7db5e3a3defc084a87a41b2b95b7e244bd977ccea2bba",),
    ),
    Benchmark(
        "Silverbox, multisine", ("SNLS80mV.mat",), silverbox(slice(105_712, 127_400)), 50, "mV", 1e3,
        f"7.73 (polynomial NARX of degree 2; {NARX})",
    ),
    Benchmark(
        "Silverbox, arrow", ("SNLS80mV.mat",), silverbox(slice(100, 40_575)), 50, "mV", 1e3,
        f"4.15 (polynomial NARX of degree 3; {NARX})",
    ),
    *(
        Benchmark(
            f"coupled drives, {level} amplitude", ("DATAUNIF.MAT",), drives(k), 4, "ticks/s", 1.0, published,
            "10 samples give the state of the published models",
        )
        for k, level, published in DRIVES
    ),
    *(
        Benchmark(
            f"coupled drives, {level} amplitude, first part", ("uniform_first400.csv",), first_of_drives(k), 4,
            "ticks/s", 1.0, published, f"{PART}: samples 300 to 400, behind the 300 that are fitted",
            ("0a6770ec78c6815e98cdbd7466a8cc3a74db4fbbf2a54b3869706f3db4a79b55",),
        )
        for k, level, published in DRIVES
    ),
    Benchmark(
        "cascaded tanks", ("dataBenchmark.mat",), tanks, 5, "V", 1.0,
        f"0.343 (NLSS2; {TABLE_OF_TANKS}, headed MSE, though its 0.54 of a Volterra model is an RMSE in the next "
        f"source), 0.51 (Volterra; {VOLTERRA})", "how the published models start is not stated",
    ),
    Benchmark(
        "EMPS", ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"), emps, 20, "mm", 1e3, AXIS,
        "the published one may be of the file for estimation", (EMPS,),
    ),
    Benchmark(
        "EMPS, first file", ("DATA_EMPS.mat",), emps, 20, "mm", 1e3, AXIS, f"{PART}: the last 30 % of the file",
        (EMPS,),
    ),
    *(
        Benchmark(
            f"process noise, {name} test signal", ("WH_CombinedZeroMultisineSinesweep.mat", "WH_TestDataset.mat"),
            process_noise(k), 0, "mV", 1e3,
            f"20.8 (network with attention, mean of both test signals; {ATTENTION}, table IV)",
            "the published model was fitted to 200 realisations, and starts from a measured sample",
        )
        for k, name in enumerate(("first", "second"))
    ),
    *(
        Benchmark(
            f"Bouc–Wen, {name}", ("fit.csv", f"uval_{file}.mat", f"yval_{file}.mat"), bouc_wen, 0, "µm", 1e6, published,
            "the records for estimation are yours",
        )
        for name, file, published in (
            ("multisine", "multisine", f"18.7 (polynomial state space, cited), 45.2 (dynoNet); {DYNONET}, "
                "which prints mm for m"),
            ("sweep", "sinesweep", "–"),
        )
    ),
    *(
        Benchmark(
            f"F-16, multisine level {k}",
            (f"F16Data_FullMSine_Level{k}.mat", f"F16Data_FullMSine_Level{k + 1}_Validation.mat"),
            ground_vibration, 0, "m/s²", 1.0, f"NRMSE of 16.2 % (recurrent equilibrium network; {EQUILIBRIUM})",
            "one level of multisines; the published error is normalised, over three levels, of a model of four",
        )
        for k in (1, 3, 5)
    ),
    Benchmark(
        "parallel Wiener–Hammerstein, largest amplitude", ("ParWHData.mat",), parallel, 0, "mV", 1e3,
        f"1.197 (state space with nonlinear feedback; {FEEDBACK})",
        "the published model was fitted to five of the records; its error is over the second period of the test",
    ),
    Benchmark(
        "industrial robot", ("forward_identification_without_raw_data.mat",), robot, 0, "deg", 1.0,
        f"12.6, 3.35, 9.78, 9.09, 7.03, 11.3 (network with attention; README of MA-LSTM-MLP; {ATTENTION})",
        "the published ones are of an example of a test series, which starts from a measured sample",
    ),
)  # fmt: skip


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
        try:
            result = emsid.identify(list(fitted), budget=budget)
        except emsid.EmsidError as problem:
            print(f"{benchmark.name}: {problem}", file=sys.stderr)
            continue
        seconds = time.process_time() - began
        model, squares, count = result.recommended, 0.0, 0
        used = max(benchmark.allowed, model.memory)
        for record in test:
            alone = emsid.Record(
                record.input, record.output, record.dt, fitted[0].input_names, fitted[0].output_names,
                fitted[0].input_units, fitted[0].output_units,
            ).in_si()  # fmt: skip
            run = free_run(model, alone, used)
            squares = squares + np.sum((alone.output - run.output)[run.counted] ** 2, axis=0)
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


HEAD = "| benchmark | model | RMSE | published | same protocol | CPU s |\n|---|---|---|---|---|---|\n"


def line_of(row: Sequence[str]) -> str:
    """A row of the table in Markdown."""
    return f"| {' | '.join(row)} |\n"


def write_rows(page: Path, measured: Sequence[Sequence[str]]) -> None:
    """Put the rows that were measured into the table of a page, in the order of `BENCHMARKS`."""
    before, head, after = page.read_text("utf-8").partition(HEAD)
    lines = after.splitlines(keepends=True)
    size = next((k for k, line in enumerate(lines) if not line.startswith("|")), len(lines))
    every = {line.split(" | ")[0].removeprefix("| "): line for line in lines[:size]}
    every |= {row[0]: line_of(row) for row in measured}
    kept = [every[each.name] for each in BENCHMARKS if each.name in every]
    page.write_text("".join([before, head, *kept, *lines[size:]]), "utf-8")


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("folder", metavar="DIR", type=Path, help="where the files are")
    parser.add_argument("names", nargs="*", metavar="NAME", help="a part of the names of the sets (default: all)")
    parser.add_argument("--budget", type=float, help="seconds of the searches of a set")
    parser.add_argument("--page", type=Path, help="a page in Markdown with the table, into which the rows are written")
    asked = parser.parse_args()
    if asked.page is not None and HEAD not in asked.page.read_text("utf-8"):
        parser.error(f"{asked.page} has no table of the leaderboard")
    print(HEAD, end="")
    for row in rows(asked.folder, asked.names, asked.budget):
        print(line_of(row), end="", flush=True)
        if asked.page is not None:
            write_rows(asked.page, [row])


if __name__ == "__main__":
    main()
