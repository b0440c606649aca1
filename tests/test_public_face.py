"""The verbs of the library: fit, compare, simulate and identify, and what they answer to wrong arguments."""

from __future__ import annotations

import inspect
import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid.options import KEYWORDS
from emsid.study import demonstration


@pytest.fixture(scope="session")
def linear_record():
    """1200 samples of y(t) = 0.8·y(t−1) + 0.5·u(t−1) + e(t) with a little white noise e."""
    rng = np.random.default_rng(1)
    u, noise = rng.standard_normal(1200), 0.01 * rng.standard_normal(1200)
    y = np.zeros(1200)
    for t in range(1, 1200):
        y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + noise[t]
    return emsid.Record(u, y, dt=0.01, name="bench")


@pytest.fixture(scope="session")
def linear_fit(linear_record):
    return emsid.fit(emsid.arx(na=1, nb=1), linear_record)


@pytest.fixture(scope="session")
def plant_fit():
    """A rigid motor of known resistance, fitted to 12 s of its own speed."""
    rng = np.random.default_rng(2)
    voltage = 3.0 * np.sign(rng.standard_normal(40)).repeat(15)
    speed = emsid.plant.simulate(emsid.Motor().rigid(), voltage, 1e-2).load_speed[: len(voltage)]
    record = emsid.Record(voltage, speed, 1e-2, input_units=("V",), output_units=("rad/s",))
    return emsid.fit(
        emsid.plants.rigid_motor(), record, fixed={"resistance": 0.8}, free=("motor_constant", "rotor_inertia")
    )


@pytest.fixture(scope="session")
def identification(linear_record):
    return emsid.identify(linear_record, models=("arx",))


def results(record, fit, plant_fit, identification):
    comparison = emsid.compare([fit], record)
    return {
        "record": record,
        "fit": fit,
        "plant": plant_fit,
        "comparison": comparison,
        "identification": identification,
    }


@pytest.fixture(scope="session", params=["record", "fit", "plant", "comparison", "identification"])
def result(request, linear_record, linear_fit, plant_fit, identification):
    return results(linear_record, linear_fit, plant_fit, identification)[request.param]


# --- fit -------------------------------------------------------------------------------------------------------------


def test_a_structure_is_fitted_by_least_squares(linear_record):
    fit = emsid.fit(emsid.arx(na=1, nb=1), linear_record)
    assert np.array_equal(fit.estimate, emsid.least_squares(emsid.arx(na=1, nb=1), linear_record).estimate)
    ridge = emsid.fit(emsid.arx(na=1, nb=1), linear_record, ridge=100.0)
    assert np.linalg.norm(ridge.estimate) < np.linalg.norm(fit.estimate)


def test_a_forgetting_factor_asks_for_the_recursion(linear_record):
    structure = emsid.arx(na=1, nb=1)
    fit = emsid.fit(structure, linear_record, forgetting=0.99)
    assert fit.method == "rls"
    assert np.array_equal(
        fit.estimate, emsid.recursive_least_squares(structure, linear_record, forgetting=0.99).estimate
    )
    with pytest.raises(emsid.ModelError, match="ridge"):
        emsid.fit(structure, linear_record, forgetting=0.99, ridge=1.0)


def test_whatever_has_a_fit_method_is_fitted(linear_record):
    class Mean:
        def fit(self, records, *, scale=1.0):
            return scale * records.output.mean()

    assert emsid.fit(Mean(), linear_record, scale=2.0) == 2 * linear_record.output.mean()
    with pytest.raises(emsid.ModelError, match="scale"):
        emsid.fit(Mean(), linear_record, scalle=2.0)


@pytest.mark.parametrize(
    ("wrong", "answer"),
    [
        (lambda r: emsid.fit("arx", r), r"emsid\.arx\("),
        (lambda r: emsid.fit(emsid.arx, r), r"call it: arx\("),
        (lambda r: emsid.fit(emsid.Motor, r), r"class.*Motor\("),
        (lambda r: emsid.fit(r, emsid.arx(na=1, nb=1)), "comes first"),
        (lambda r: emsid.fit(42, r), "structure"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), "log.csv"), r"emsid\.read"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), r.input), r"emsid\.Record"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), [r.input]), r"emsid\.Record"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), []), "no record"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), r, rigde=1.0), "did you mean ridge"),
        (lambda r: emsid.fit(emsid.plants.rigid_motor(), r, fix={"resistance": 2}), "did you mean fixed"),
        (lambda r: emsid.fit(emsid.hammerstein(1), r, contrl=None), "no option 'contrl'.*did you mean control"),
        (lambda r: emsid.fit(emsid.Cascade(emsid.blocks.Rational([1.0], [-0.5])), r, fixd=()), "did you mean fixed"),
        (lambda r: emsid.fit(emsid.Cascade(emsid.blocks.Rational([1.0], [-0.5])), r, orders=(1,)), "no option"),
        (lambda r: emsid.fit(emsid.fit(emsid.arx(na=1, nb=1), r), r), "has been fitted"),
    ],
)
def test_what_cannot_be_fitted_is_answered(linear_record, wrong, answer):
    with pytest.raises(emsid.EmsidError, match=answer):
        wrong(linear_record)


@pytest.mark.long
def test_a_plant_is_fitted_as_identify_fits_it():
    record = demonstration.motor_record()
    train, test = record.split(0.7)
    fit = emsid.fit(emsid.plants.rigid_motor(), train, fixed={"resistance": 0.8})
    found = emsid.identify(train, test, models="rigid-motor", fixed={"resistance": 0.8})
    assert fit.names == found.chosen.names
    np.testing.assert_allclose(fit.estimate, found.chosen.estimate, rtol=1e-9)


def test_a_plant_is_fitted_exactly_where_that_is_asked_for(linear_record):
    motor = emsid.plants.rigid_motor()
    with pytest.raises(emsid.ModelError, match="additions are searched for"):
        emsid.fit(motor, linear_record, free="motor_constant", search=True)


# --- compare ---------------------------------------------------------------------------------------------------------


def test_compare_takes_one_fit_several_or_models(linear_record, linear_fit):
    other = emsid.fit(emsid.arx(na=2, nb=1), linear_record)
    one = emsid.compare(linear_fit, linear_record)
    assert one.best.fit is linear_fit
    several = emsid.compare([linear_fit, other], linear_record)
    assert {row.parameters for row in several.rows} == {2, 3}
    for same in (
        emsid.compare(linear_fit, other, linear_record),
        emsid.compare(other, linear_fit.model, record=linear_record),
    ):
        assert [row.simulation_mse for row in same.rows] == [row.simulation_mse for row in several.rows]
    model = emsid.compare(linear_fit.model, linear_record)
    assert model.best.row.simulation_mse == one.best.row.simulation_mse
    both = emsid.compare((fit for fit in (linear_fit, other)), [linear_record, linear_record])
    assert len(both.best.record) == 2 * len(linear_record)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda fit, r: emsid.compare(r, fit),
        lambda fit, r: emsid.compare([fit], r.output),
        lambda fit, r: emsid.compare([fit, r], r),
        lambda fit, r: emsid.compare(["arx"], r),
        lambda fit, r: emsid.compare("arx", r),
        lambda fit, r: emsid.compare([fit], [fit]),
        lambda fit, r: emsid.compare([], r),
        lambda fit, r: emsid.compare(fit),
        lambda fit, r: emsid.compare(fit, r, fit),
        lambda fit, r: emsid.compare(fit, r, r),
        lambda fit, r: emsid.compare(fit, "speed", r),
    ],
)
def test_what_cannot_be_compared_is_answered(linear_record, linear_fit, wrong):
    with pytest.raises(emsid.EmsidError):
        wrong(linear_fit, linear_record)


# --- the table of a fit ----------------------------------------------------------------------------------------------


def test_a_fit_is_a_table_by_name(linear_fit, plant_fit):
    row = linear_fit["a1"]
    assert (row.value, row.standard_error) == (linear_fit.estimate[0], linear_fit.standard_error[0])
    assert row.interval == tuple(linear_fit.interval()[0])
    assert list(linear_fit.parameters) == ["a1", "b1"]
    inertia = plant_fit["rotor_inertia"]
    assert inertia.unit == "kg*m^2"
    assert inertia.interval[0] < inertia.value < inertia.interval[1]
    assert plant_fit["J_m"] is inertia
    assert plant_fit["resistance"].status == "fixed"
    assert plant_fit["resistance"].interval is None
    with pytest.raises(emsid.ModelError, match=r"no parameter 'rotor_inertja'.*did you mean rotor_inertia"):
        _ = plant_fit["rotor_inertja"]
    with pytest.raises(TypeError):
        iter(linear_fit)


def test_a_fit_has_what_its_model_has(linear_fit, linear_record):
    assert linear_fit.dt == 0.01
    assert np.array_equal(linear_fit.simulate(linear_record).output, linear_fit.model.simulate(linear_record).output)
    assert {"simulate", "with_parameters", "interval"} <= set(dir(linear_fit))
    with pytest.raises(AttributeError):
        _ = linear_fit.no_such_thing


def test_a_fit_is_saved_with_its_table(plant_fit, linear_record, tmp_path):
    emsid.save(plant_fit, tmp_path / "motor.json")
    again = emsid.load(tmp_path / "motor.json")
    assert again.parameters == plant_fit.parameters
    assert np.array_equal(again.covariance, np.tril(plant_fit.covariance) + np.tril(plant_fit.covariance, -1).T)
    assert str(again) == str(plant_fit)
    voltage = np.ones(50)
    simulated = emsid.simulate(again, voltage, dt=0.01)
    assert np.array_equal(simulated.output, emsid.simulate(plant_fit, voltage, dt=0.01).output)


def test_what_if_a_parameter_were_another(plant_fit):
    warm = plant_fit.with_parameters(resistance=2.6)
    assert warm.plant.value("resistance") == 2.6
    slower, usual = (emsid.simulate(each, 3.0 * np.ones(200), dt=0.01).output[:, 0] for each in (warm, plant_fit))
    assert slower[1] < usual[1]  # without friction, both end at one speed


def test_the_recommended_fit_has_the_values_of_the_recommended_model(identification):
    fit = identification.recommended_fit
    assert fit.model is identification.recommended
    assert [fit[name].value for name in fit.names] == list(fit.model.parameters)


# --- simulate --------------------------------------------------------------------------------------------------------


def test_simulating_on_a_record_is_the_free_run(linear_record, linear_fit):
    simulated = emsid.simulate(linear_fit, linear_record)
    assert np.array_equal(simulated.input, linear_record.input)
    assert np.array_equal(simulated.output, linear_fit.model.simulate(linear_record).output)


def test_an_input_is_enough(linear_fit):
    u = np.sin(np.arange(50.0))
    simulated = emsid.simulate(linear_fit, u)
    expected = np.zeros(50)
    a, b = linear_fit.estimate
    for t in range(1, 50):
        expected[t] = -a * expected[t - 1] + b * u[t - 1]
    assert simulated.dt == 0.01
    assert simulated.output[:, 0] == pytest.approx(expected, abs=1e-12)
    alone = emsid.simulate(linear_fit.model, emsid.Record(u, dt=0.01))
    assert np.array_equal(alone.output, simulated.output)


def test_simulated_outputs_have_names_and_units(linear_record, plant_fit):
    named = replace(
        linear_record, input_names=("voltage",), output_names=("speed",), input_units=("V",), output_units=("rad/s",)
    )
    fit = emsid.fit(emsid.arx(na=1, nb=1), named)
    simulated = emsid.simulate(fit, np.ones(20))
    assert (simulated.input_names, simulated.input_units) == (("voltage",), ("V",))
    assert (simulated.output_names, simulated.output_units) == (("speed",), ("rad/s",))
    motor = emsid.simulate(emsid.plants.rigid_motor(), np.ones(20), dt=0.01)
    assert (motor.output_names, motor.output_units) == (("speed",), ("rad/s",))


@pytest.mark.parametrize("library", ["polars", "pandas"])
def test_a_record_becomes_a_frame_and_back(linear_record, library):
    frame = linear_record.to_frame(library)
    assert type(frame).__module__.split(".")[0] == library
    again = emsid.Record.from_frame(frame, input="u1", output="y1", time="t")
    assert np.array_equal(again.input, linear_record.input)
    assert np.array_equal(again.output, linear_record.output)
    assert again.dt == pytest.approx(linear_record.dt)
    with pytest.raises(emsid.DataError, match="give 'polars' or 'pandas'"):
        linear_record.to_frame("excel")


def test_plants_are_simulated_from_an_input():
    voltage = 3.0 * np.ones(100)
    motor = emsid.simulate(emsid.Motor(), voltage, dt=1e-2)
    exact = emsid.plant.simulate(emsid.Motor(), voltage, 1e-2).load_speed
    assert motor.output[:, 0] == pytest.approx(exact[:100], abs=1e-6)
    assert emsid.simulate(emsid.plants.linear_axis(), voltage, dt=1e-2).output[-1, 0] > 0


def test_a_cascade_is_simulated_at_the_sample_time_given():
    cascade = emsid.Cascade((emsid.blocks.Rational([1.0, 0.5], [-0.5]), emsid.blocks.DeadZone(-0.2, 0.2)))
    assert emsid.simulate(cascade, np.ones(100), dt=0.1).output[-1, 0] == pytest.approx(1.5 / 0.5 - 0.2)


def test_a_run_that_diverges_is_answered():
    unstable = emsid.RegressionModel(emsid.Structure.parse("y(t-1)^2", "u(t-1)"), np.array([2.0, 1.0]), dt=0.1)
    with pytest.raises(emsid.ModelError, match="diverges"):
        emsid.simulate(unstable, np.ones(100))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda fit: emsid.simulate(fit, np.ones(10), dt=0.5),
        lambda fit: emsid.simulate(emsid.Motor(), np.ones(10)),
        lambda fit: emsid.simulate(fit, "log.csv", dt=0.01),
        lambda fit: emsid.simulate("model.json", np.ones(10), dt=0.01),
        lambda fit: emsid.simulate(emsid.Motor, np.ones(10), dt=0.01),
        lambda fit: emsid.simulate(np.ones(10), fit, dt=0.01),
    ],
)
def test_what_cannot_be_simulated_is_answered(linear_fit, wrong):
    with pytest.raises(emsid.EmsidError):
        wrong(linear_fit)


# --- identify --------------------------------------------------------------------------------------------------------


def test_identify_reads_a_file(linear_record, tmp_path):
    path = tmp_path / "log.csv"
    emsid.write_record(linear_record, path)
    found = emsid.identify(path, models="arx", input="u1", output="y1", time="t")
    assert found.chosen.model.name == "arx"
    assert np.allclose(found.chosen.estimate, emsid.identify(linear_record, models=("arx",)).chosen.estimate)
    assert np.allclose(emsid.identify(str(path), models="arx").chosen.estimate, found.chosen.estimate)
    with pytest.raises(emsid.DataError, match=r"name its columns.*u1"):
        emsid.identify(str(path), input="u1", time="t")
    with pytest.raises(emsid.DataError, match=r"did you mean models"):
        emsid.identify(path, model="arx")


def test_models_may_be_one_text(linear_record):
    with pytest.raises(emsid.ModelError, match=r"no model is called arxx; there are arx.*did you mean arx\?"):
        emsid.identify(linear_record, models="arxx")
    found = emsid.identify(linear_record, models="arx, friction-narx")
    assert {fit.model.name for fit in found.fits} == {"arx", "friction-narx"}


@pytest.mark.parametrize("wrong", [lambda r: emsid.identify(r.input), lambda r: emsid.identify(42)])
def test_what_identify_cannot_use_is_answered(linear_record, wrong):
    with pytest.raises(emsid.DataError, match=r"emsid\.Record"):
        wrong(linear_record)


def test_options_are_keywords(linear_record):
    keywords = inspect.signature(emsid.identify).parameters
    defaults = emsid.Options()
    for name in KEYWORDS:
        assert keywords[name].default in (getattr(defaults, name), None)
    found = emsid.identify(linear_record, models="arx", na=2, nb=3, nk=1)
    assert found.chosen.names == ("a1", "a2", "b1", "b2", "b3")
    with pytest.raises(emsid.ModelError, match="options and na are given"):
        emsid.identify(linear_record, models="arx", na=2, options=emsid.Options(nb=1))


def test_options_understand_a_name_for_a_family_and_for_a_list():
    assert emsid.Options(static="dead-zone").static.name == "dead-zone"
    with pytest.raises(emsid.ModelError, match="did you mean dead-zone"):
        emsid.Options(static="deadzone")
    assert emsid.Options(free="motor_constant", profile="motor_constant").profile == ("motor_constant",)


# --- cascades --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("static", [emsid.blocks.DeadZone(), emsid.blocks.DeadZone, "dead-zone"])
def test_a_static_map_is_given_as_a_value_a_class_or_a_name(static):
    assert emsid.hammerstein(order=1, static=static).search.static.name == "dead-zone"


@pytest.fixture(scope="session")
def dead_zone_record():
    """A first-order filter behind a dead zone from −0.3 to 0.2."""
    cascade = emsid.Cascade((emsid.blocks.DeadZone(-0.3, 0.2), emsid.blocks.Rational([0.0, 0.2], [-0.8])))
    u = np.random.default_rng(5).uniform(-1, 1, 1500)
    record = emsid.simulate(cascade, u, dt=0.01)
    return replace(record, output=record.output + 1e-3 * np.random.default_rng(6).standard_normal((1500, 1)))


def test_a_cascade_is_a_noun_that_is_fitted(dead_zone_record):
    structure = emsid.hammerstein(order=1, static=emsid.blocks.DeadZone(), delay=0, oversampling=1, max_iterations=50)
    assert len(repr(structure)) < 120
    fit = emsid.fit(structure, dead_zone_record)
    zone = fit.model.blocks[0]
    assert (zone.b_l, zone.b_r) == pytest.approx((-0.3, 0.2), abs=0.01)
    assert "f.b_l" in str(fit)
    with pytest.raises(emsid.ModelError, match="did you mean max_iterations"):
        emsid.hammerstein(order=1, max_iteration=50)
    with pytest.raises(emsid.ModelError, match="no option 'max_iterations'"):
        emsid.fit(structure, dead_zone_record, max_iterations=50)


@pytest.mark.parametrize(
    ("wrong", "answer"),
    [
        (lambda r: emsid.wiener_hammerstein(r, (1, 2), emsid.Options()), r"emsid\.fit\(emsid\.wiener_hammerstein"),
        (lambda r: emsid.hammerstein([r]), r"emsid\.fit\(emsid\.hammerstein"),
        (lambda r: emsid.wiener_hammerstein(orders=2), "one for each filter"),
        (lambda r: emsid.wiener_hammerstein((1, 2), static="deadzone"), "did you mean dead-zone"),
        (lambda r: emsid.wiener_hammerstein((1, 2), static=emsid.DeadZoneLaw(-0.1, 0.1)), "no static map"),
        (lambda r: emsid.wiener_hammerstein((1, 2), static=emsid.Options()), "takes no Options"),
        (lambda r: emsid.fit(emsid.wiener_hammerstein, r), r"call it: wiener_hammerstein"),
    ],
)
def test_what_is_no_cascade_is_answered(linear_record, wrong, answer):
    with pytest.raises(emsid.ModelError, match=answer):
        wrong(linear_record)


# --- how results look ------------------------------------------------------------------------------------------------


def test_repr_is_one_line(result):
    assert "\n" not in repr(result)
    assert len(repr(result)) < 120


def test_a_result_draws_itself_in_a_notebook(result):
    html = result._repr_html_()
    assert "<table>" in html
    image = re.search(r'src="data:image/svg\+xml;base64,([^"]+)"', html)
    assert b"<svg" in b64decode(image[1])


def test_a_result_can_be_plotted(result, tmp_path):
    figure = result.plot()
    figure.savefig(tmp_path / "figure.svg")
    assert (tmp_path / "figure.svg").stat().st_size > 1000


def test_a_plotted_record_shows_one_unit_of_each_channel():
    record = emsid.Record(np.ones(20), np.arange(20.0), 0.1, "Voltage (V)", "Speed (rpm)", "V", "rad/s")
    assert [axes.get_ylabel() for axes in record.plot().axes] == ["Voltage [V]", "Speed [rad/s]"]


def test_a_fit_says_how_it_was_fitted(linear_record, linear_fit):
    free = emsid.fit(emsid.arx(na=1, nb=1), linear_record, free_run=True)
    assert repr(linear_fit).startswith("Fit(arx, one step: ")
    assert repr(free).startswith("Fit(arx, free run: ")
    found = emsid.compare([linear_fit, free], linear_record)
    assert {row.split()[0] + " " + " ".join(row.split()[1:3]) for row in str(found).splitlines()[2:]} == {
        "arx one step",
        "arx free run",
    }
    assert {"y1 by arx, one step", "y1 by arx, free run"} <= set(found.to_frame().columns)


def test_a_fit_of_a_plant_knows_the_sample_time_of_its_data(plant_fit, tmp_path):
    voltage = np.full(50, 3.0)
    assert emsid.simulate(plant_fit, voltage).dt == 1e-2
    np.testing.assert_array_equal(emsid.simulate(plant_fit, voltage).output, plant_fit.simulate(voltage).output)
    emsid.export(plant_fit, to="c99", out=tmp_path / "c")
    assert "0.01" in (tmp_path / "c" / "rigid_motor.h").read_text()
    with pytest.raises(emsid.ModelError, match="give dt"):
        emsid.export(plant_fit.model, to="c99", out=tmp_path / "other")


def test_a_linear_part_keeps_names_and_units(linear_fit, plant_fit):
    named = ["u1 [V]"], ["y1 [rad/s]"]
    assert repr(emsid.to_continuous(plant_fit)).startswith("LinearSystem(rigid-motor: u1 [V] → y1 [rad/s], ")
    for system in (plant_fit.to_control(), emsid.to_discrete(plant_fit, 1e-3).to_control()):
        assert (system.input_labels, system.output_labels, system.name) == (*named, "rigid-motor")
        assert len(system.poles()) == len(emsid.poles(plant_fit))
    system = linear_fit.to_control()
    assert (system.input_labels, system.output_labels, system.name) == (["u1"], ["y1"], "arx")


def test_the_picture_of_a_fitted_plant_has_its_friction(plant_fit):
    _, run, friction = plant_fit.plot().axes
    assert friction.get_xlabel() == "Speed ω [rad/s]"
    assert run.get_xlim() != friction.get_xlim()


def test_a_row_and_a_first_look_are_one_short_line(plant_fit, linear_record, tmp_path):
    linear_record.to_frame().write_csv(tmp_path / "log.csv")
    for each in (plant_fit["rotor_inertia"], emsid.describe(tmp_path / "log.csv")):
        assert len(repr(each)) < 140
        assert repr(each).startswith(f"{type(each).__name__}(")


def test_a_fit_without_intervals_draws_its_estimates(linear_record):
    noise = 0.5 * np.random.default_rng(3).standard_normal((len(linear_record), 1))
    biased = emsid.fit(emsid.arx(na=1, nb=1), replace(linear_record, output=linear_record.output + noise))
    assert biased.biased
    (axis,) = biased.plot().axes
    widths = sorted(bar.get_width() for bar in axis.patches)
    assert widths == pytest.approx(sorted(np.abs(biased.estimate)))


def test_a_fit_prints_every_parameter_with_interval_and_ending(linear_fit):
    head, names, *rows = str(linear_fit).splitlines()
    assert head.startswith("arx, one step: solved")
    assert names.split("  ")[0] == "Parameter"
    for row, name, (low, high) in zip(rows, linear_fit.names, linear_fit.interval(), strict=False):
        printed, _, least, _, most, *_ = row.split()
        assert printed == name
        assert float(least) == pytest.approx(low, abs=0.06 * (high - low))
        assert float(most) == pytest.approx(high, abs=0.06 * (high - low))


def test_a_fit_of_a_plant_prints_units_and_what_was_fixed(plant_fit):
    rows = {line.split()[0]: line for line in str(plant_fit).splitlines()}
    assert "N·m/A" in rows["motor_constant"]
    assert "fixed" in rows["resistance"]
    assert "Ω" in rows["resistance"]
    assert str(plant_fit).startswith(f"rigid-motor, free run: {plant_fit.ending.value}")


def test_a_parameter_that_the_data_do_not_determine_has_no_interval():
    positive = np.random.default_rng(0).uniform(1, 2, 200)
    record = emsid.Record(positive, np.roll(positive, 1), dt=0.1)
    fit = emsid.fit(emsid.Structure.parse("u(t-1)", "abs(u(t-1))"), record)
    assert "not determined" in str(fit)


def test_names_from_files_are_escaped_in_a_notebook(linear_record):
    bad = replace(linear_record, name="<script>alert(1)</script>", input_names=("<b>u</b>",))
    assert "<script>" not in bad._repr_html_()
    assert "<b>" not in bad._repr_html_()
    comparison = emsid.compare(emsid.fit(emsid.arx(na=1, nb=1), bad), bad)
    assert "<script>" not in comparison._repr_html_()
    named = emsid.fit(emsid.Structure.parse("y(t-1)", "u(t-1)", name="<i>mine</i>"), bad)
    assert "<i>" not in named._repr_html_()
    assert len(repr(named)) < 120
