"""Results of every kind that the tests of the report show, and every figure and table made of them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import emsid
from emsid.estimation.fit import Ending, Fit
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import fit_cascade
from emsid.models.blocks.static_maps import Abs, CoulombLinear, CubicSpline, PiecewiseLinear, Polynomial, Saturation
from emsid.models.blocks.static_maps import DeadZone as DeadZoneMap
from emsid.models.plants.datasheet import Given
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.diagnostics import likelihood_profile
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.sensor import Sensor
from emsid.plant import DeadZoneLaw, Friction, Motor
from emsid.plant.motor import Parameter
from emsid.record import Record, concatenate
from emsid.report import views
from emsid.report.document import (
    Axis,
    Band,
    Bars,
    Dash,
    Figure,
    Histogram,
    Ink,
    Level,
    Line,
    Plot,
    Points,
    Spans,
    Stroke,
)
from emsid.report.views import cascade as cascade_views
from emsid.report.views import grey_box as grey_box_views
from emsid.report.views.grey_box import physical_table
from emsid.validation.comparison import assess, assess_model, compare

NASTY = '<script>alert("$x_1$")</script>'


def drive(samples=1200, seed=0, name="bench", dt=0.01):
    """A record of a first-order drive with a dead zone and friction, so that a linear model has trouble."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(samples)
    u = 3 * np.sin(2 * np.pi * 0.4 * t) + 2 * np.sin(2 * np.pi * 1.3 * t + seed)
    y = np.zeros(samples)
    for k in range(1, samples):
        push = np.sign(u[k - 1]) * max(abs(u[k - 1]) - 1.5, 0.0)
        y[k] = 0.9 * y[k - 1] + push
    y += 0.02 * rng.standard_normal(samples)
    return Record(u, y, dt, ("voltage",), ("speed",), ("V",), ("rad/s",), name=name)


def with_gaps():
    """The same in three pieces, the last of them an experiment of its own that begins at zero again."""
    record = drive()
    masked = record.mask((np.arange(len(record)) // 200) % 3 == 1)
    return concatenate([masked, drive(300, seed=3)])


STRUCTURES = (
    emsid.arx(na=2, nb=2),
    emsid.wiener_hammerstein_regression(na=2, nb=2, degree=2),
    emsid.friction_narx(na=1, nb=2, knots=(-1.5, 1.5)),
)
RUNAWAY = Fit(emsid.arx(1, 1).model(np.array([-1.2, 1.0]), drive(10)), ("a1", "b1"), np.array([-1.2, 1.0]),
              np.diag([0.1, np.inf]), 1.0, 100, 1.0, 1, Ending.RANK_DEFICIENT,
              findings=(Finding("rank-deficient", data={"rank": 1, "parameters": 2, "zero": ["u(t-1)"], "alike": []}),),
              )  # fmt: skip


def comparison(record):
    return compare([*(emsid.least_squares(structure, drive(seed=1)) for structure in STRUCTURES), RUNAWAY], record)


class Later:
    """A table or a list that is made when a test first looks into it, and not when the tests are collected.

    Only these methods make it: the collection asks every object for attributes.
    """

    def __init__(self, make):
        self._make = cache(make)

    def __getitem__(self, key):
        return self._make()[key]

    def keys(self):
        return self._make().keys()

    def values(self):
        return self._make().values()

    def items(self):
        return self._make().items()


COMPARISONS = Later(lambda: {"whole": comparison(drive()), "with gaps": comparison(with_gaps())})
RECURSIVE = Later(lambda: [emsid.recursive_least_squares(structure, drive(), history=True) for structure in STRUCTURES])
MOTORS = {
    "default": Motor(),
    "two dead zones": Motor(torque_dead_zone=DeadZoneLaw(-1e-3, 2e-3, 0.5, 2.0)),
    "no dead zone": Motor(voltage_dead_zone=None),
    "uneven": Motor(rotor_friction=Friction((0.1, 0.2), (0.05, 0.0), 0.4), load_friction=Friction()),
    "linear": Motor(voltage_dead_zone=None, rotor_friction=Friction(), load_friction=Friction()),
}


FIRST, SECOND = Rational([0.1, 0.2], [-0.7]), Rational([0.25, 0.25], [-0.5])
KNOTS = np.linspace(-5, 5, 9)
CASCADES = {
    "spline": Cascade((FIRST, CubicSpline(KNOTS, 4 * np.tanh(KNOTS / 3)), SECOND), name="wiener-hammerstein"),
    "dead zone": Cascade((DeadZoneMap(-1.5, 1.0, 0.5, 1.0), SECOND), input_offset=0.2, delay=2, name="hammerstein"),
    "saturation": Cascade((FIRST, Saturation(0.8, -2.0, 1.5)), oversampling=2, name="wiener"),
    "piecewise": Cascade(
        (
            PiecewiseLinear([-4.0, 0.0, 4.0], [-3.0, 0.5, 5.0]),
            SECOND,
            Polynomial.from_powers([0.0, 1.0, 0.02], -5.0, 5.0),
        ),
        name="hammerstein-wiener",
    ),
    "Coulomb": Cascade((CoulombLinear(0.5, 0.5, 1.0), FIRST), name="hammerstein"),
    "sign lost": Cascade((FIRST, Abs(), SECOND), name="wiener-hammerstein"),
    "no map": Cascade((FIRST,), name="filter"),
    "no filter": Cascade((DeadZoneMap(-1.0, 1.0, 1.0, 1.0),), name="map"),
}


def of_cascade(cascade, record=None):
    """A cascade fitted to its own output with a little noise, from where it is."""
    record = drive() if record is None else record
    rng = np.random.default_rng(5)
    y = np.concatenate([cascade.output(s.input[:, 0], cascade.resting(0.0)) for s in record.segments])
    noisy = replace(record, output=(y + 0.02 * rng.standard_normal(len(y)))[:, None])
    return replace(fit_cascade(cascade, noisy, max_iterations=0), ending=Ending.CONVERGED), noisy  # begun at the truth


def driven(plant, dt=0.005, seconds=6.0, signal=Signal.SPEED, name="motor log"):
    """A record of a plant that is driven back and forth and stands still in between."""
    rng = np.random.default_rng(2)
    t = dt * np.arange(round(seconds / dt))
    u = np.where(np.sin(2.1 * t) > 0.6, 10.0, np.where(np.sin(2.1 * t) < -0.6, -8.0, 0.0)) + 2 * np.sin(0.7 * t)
    y = plant.simulate(u[:, None], dt, np.zeros(2), (signal,))[:, 0]
    noise = 1e-3 * np.max(np.abs(y)) * rng.standard_normal(len(y))
    shown, unit = ("position", "m") if isinstance(plant, LinearAxis) else ("speed", "rad/s")
    force = ("force", "N") if isinstance(plant, LinearAxis) else ("voltage", "V")
    return Record(u, y + noise, dt, (force[0],), (shown,), (force[1],), (unit,), name=name)


RIGID = DrivenMotor(
    replace(Motor(), inductance=0.0, rotor_friction=Friction(0.02), voltage_dead_zone=DeadZoneLaw(-0.5, 0.5)).rigid()
)
AXIS = LinearAxis(2.0, 3.0, Friction(2.0))
DECAY = OwnPlant(
    lambda x, u, p: [p[0] * (u[0] - x[0])],
    lambda x, u, p: [x[0]],
    (Parameter("rate", "r", "1/s", "rate of decay"),),
    (2.0,),
    1,
    name="decay",
)


def of_plants():
    rng = np.random.default_rng(1)
    log = driven(RIGID)
    yield "rigid motor", simulation_error(RIGID, log, fixed={"resistance": RIGID.motor.resistance})
    yield (
        "nothing known, with a lag",
        simulation_error(
            replace(RIGID, sensor=Sensor(lag=0.02)), [log[:500], replace(log[600:], times=(0.0,))], max_iterations=3
        ),
    )
    yield (
        "datasheet",
        simulation_error(
            RIGID,
            log,
            free=("motor_constant", "rotor_inertia"),
            datasheet={"motor_constant": Given(1.05 * RIGID.motor.motor_constant, 0.3)},
        ),
    )
    yield "no units", simulation_error(RIGID, replace(log, input_units=("",), output_units=("",)), max_iterations=2)
    yield "axis", simulation_error(AXIS, driven(AXIS, signal=Signal.POSITION), max_iterations=3)
    u = rng.standard_normal(300)
    decay = DECAY.simulate(u[:, None], 0.1, np.zeros(1), (Signal.SPEED,))
    yield "own plant", simulation_error(DECAY, Record(u, decay + 0.01 * rng.standard_normal((300, 1)), 0.1))


@cache
def two_outputs(samples=1200):
    """A motor log of speed and current, with a gap, and two motors run over it: one a little off, one far off."""
    rng = np.random.default_rng(4)
    u = driven(RIGID, seconds=0.005 * samples).input
    y = RIGID.simulate(u, 0.005, np.zeros(2), (Signal.SPEED, Signal.CURRENT))
    y = y + rng.standard_normal(y.shape) * [1.0, 0.01]
    log = Record(u, y, 0.005, ("voltage",), ("speed", "current"), ("V",), ("rad/s", "A"), name="two")
    log = log.mask((np.arange(samples) > 500) & (np.arange(samples) < 560))
    motors = [RIGID.with_values({"resistance": k * RIGID.motor.resistance}) for k in (1.02, 1.5)]
    signals = (Signal.SPEED, Signal.CURRENT)
    return log, [assess_model(GreyBox(motor, signals), log) for motor in motors]


def of_profiles():
    taken = likelihood_profile(PLANT_FITS["rigid motor"], "rotor_inertia")
    yield "taken", taken
    values, deviance = np.array([0.0, 1.0, 13.0]), np.array([3.0, 0.0, 0.9])
    unlimited = {"interval": (0.0, np.inf), "estimate": 1.0, "standard_error": 0.5}
    yield "open", replace(taken, name="rotor_friction.coulomb", values=values, deviance=deviance, **unlimited)


CASCADE_FITS = Later(lambda: {kind: of_cascade(cascade) for kind, cascade in CASCADES.items()})
PLANT_FITS = Later(lambda: dict(of_plants()))
PROFILES = Later(lambda: dict(of_profiles()))


def every_figure():
    """Every view of every kind of result."""
    for kind, motor in MOTORS.items():
        yield f"nonlinearities of a motor, {kind}", views.nonlinearities(motor)
    for kind, result in COMPARISONS.items():
        record, each = result.best.record, result.assessments
        error = record.output - each[1].simulation.output
        yield f"inputs, {kind}", views.inputs([record, drive()])
        yield f"responses, {kind}", views.responses(each, views.critical_intervals(record, 1.0, error))
        yield f"residuals, {kind}", views.residuals(each)
        yield f"ranking, {kind}", views.ranking(result)
        for assessment in each:
            yield f"{assessment.row.model} on a record {kind}", views.measured_and_simulated(assessment)
    for fit in RECURSIVE[:]:
        yield (
            f"convergence of {fit.model.name}",
            views.convergence(fit, emsid.least_squares(fit.model.structure, drive())),
        )
    yield "convergence without batch", views.convergence(RECURSIVE[0])
    for kind, (fit, record) in CASCADE_FITS.items():
        for view in (cascade_views.static_maps(fit, record), cascade_views.frequency_responses(fit, record.dt)):
            if view is not None:
                yield f"{view.name}, {kind}", view
    for kind, fit in PLANT_FITS.items():
        if kind == "no units":
            continue
        for view in (grey_box_views.friction(fit), grey_box_views.dead_zone(fit), grey_box_views.sticking(fit)):
            if view is not None and kind != "own plant":
                yield f"{view.name}, {kind}", view
    for kind, profile in PROFILES.items():
        yield f"likelihood profile, {kind}", grey_box_views.likelihood(PLANT_FITS["rigid motor"], profile)
    two, runs = two_outputs()
    yield "two outputs, responses", views.responses(runs, views.critical_intervals(two, 0.5, error_of(runs[1])))
    yield "two outputs, residuals", views.residuals(runs)
    yield "two outputs, ranking", views.ranking(compare([run.fit for run in runs], two))
    yield "two outputs, free run", views.measured_and_simulated(runs[0])
    two_inputs = replace(drive(), input=np.column_stack([drive().input, drive(seed=5).input]),
                         input_names=("u1", "u2"), input_units=("V", "A"))  # fmt: skip
    linear = assess(emsid.least_squares(emsid.arx(2, 2, inputs=2), two_inputs), two_inputs)
    yield "two inputs", views.inputs([two_inputs])
    yield "two inputs, residuals", views.residuals([linear])
    yield "two inputs, nonlinear correlations", views.nonlinear_correlations([linear])
    yield "every mark", every_mark()


def error_of(assessment):
    return assessment.record.output - assessment.simulation.output


def every_mark():
    x = np.linspace(0.1, 10, 50)
    marks = (
        Histogram(np.linspace(0, 10, 21), np.arange(20.0), "data", backdrop=True),
        Band(x, x - 1, x + 1, "95 % band"),
        Line(x, x, "map", Stroke(Ink.RED, Dash.DASH_DOTTED)),
        Line(x, x**0.5, "stairs", stairs=True),
        Points(x[::10], x[::10], "points", Ink.GREEN),
        Level(5.0, "level"),
        Spans(np.array([[1.0, 2.0], [4.0, 4.5]]), "spans"),
        Histogram(np.linspace(0, 10, 11), np.ones(10), "outline"),
    )
    gain = Plot((Line(x, -20 * np.log10(x), "first filter"),), Axis("Frequency", "Hz", log=True), Axis("Gain", "dB"))
    bars = Plot((Bars(np.array([2.0, np.inf]), ("2", "none")),), Axis("RMSE", "V"), Axis("Model", names=("a", "b")))
    return Figure("marks", "All marks.", (Plot(marks, Axis("u", "V"), Axis("w", "V"), span=2), gain, bars), columns=2)


def every_table():
    return {
        "results": views.results_table(COMPARISONS["whole"].rows, unit="rad/s"),
        "parameters": views.parameter_table(RECURSIVE[2], columns=views.regressor_column(RECURSIVE[2])),
        "undetermined parameters": views.parameter_table(RUNAWAY),
        "motor": views.motor_table(MOTORS["uneven"]),
        "rigid motor": views.motor_table(Motor().rigid()),
        "blocks": views.parameter_table(
            CASCADE_FITS["spline"][0], columns=cascade_views.block_column(CASCADE_FITS["spline"][0])
        ),
    } | {
        f"physical, {kind}, {k}": table
        for kind, fit in PLANT_FITS.items()
        for k, table in enumerate(physical_table(fit))
    }


FIGURES = Later(lambda: dict(every_figure()))
TABLES = Later(every_table)
VIEWS = json.loads((Path(__file__).parent / "golden" / "report_views.json").read_text())


def inside(shape):
    """The corners of a path of the page, (n, 2), and whether each begins a new piece."""
    corners, starts, at = [], [], np.zeros(2)
    for letter, words in re.findall(r"([MlhzHV])([^MlhzHV]*)", shape.path):
        values = np.array([float(v) for v in re.findall(r"-?\d+", words)])
        if letter == "M":
            at = values
            corners.append(at)
            starts.append(True)
        elif letter == "l":
            for step in values.reshape(-1, 2):
                at = at + step
                corners.append(at)
                starts.append(False)
    return np.array(corners), np.array(starts)
