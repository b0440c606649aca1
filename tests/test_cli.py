"""The command line as a user meets it: its commands, what they print, and how a terminal shows it."""

import io
import json
import os
import subprocess
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest

import emsid
from command_line import IDENTIFY, MOTOR, table
from emsid.cli.app import app
from emsid.identification.candidates import CANDIDATES

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")


def test_simulate_then_describe(run, tmp_path):
    path = tmp_path / "made.csv"
    status, out, _ = run("simulate", "--excitation", "prbs", "--duration", "2", "--out", path)
    assert status == 0
    assert "400 samples, crest factor 1.00" in out
    status, out, _ = run("describe", path, "--input", "voltage", "--output", "speed", "--time", "t")
    assert status == 0
    assert "time column t [s]: 400 samples, dt 5 ms, jitter 0 %, no gaps, no duplicates\n" in out
    assert "- voltage [V] is rich enough for linear models and for friction" in out


def test_quantisation_is_no_excitation_unless_it_is_asked_for(run, tmp_path):
    path = tmp_path / "made.csv"
    assert run("simulate", "--duration", "20", "--out", path)[0] == 0  # five sines, in steps of a converter
    words = ("describe", path, "--input", "voltage", "--output", "speed", "--time", "t")
    for tolerance, order in (("1e-3", 10), ("1e-6", 50)):
        (record,) = json.loads(run(*words, "--json", "--tolerance", tolerance)[1])["records"]
        assert record["persistent_excitation_order"] == order
    for wrong in ("0", "2", "nan"):
        status, out, err = run(*words, "--tolerance", wrong)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert "give a number between 0 and 1" in err


def test_a_low_order_of_excitation_is_called_too_low(run, tmp_path):
    path = tmp_path / "step.csv"
    path.write_text("u,y\n" + "".join(f"{int(t > 100)},{t}\n" for t in range(400)))
    out = run("describe", path, "--input", "u", "--output", "y", "--dt", "1ms")[1]
    assert "too poor for a linear model of second order" in out


def test_list_names_every_model_and_signal(run):
    from emsid.excitation import SIGNALS

    status, out, _ = run("list")
    assert status == 0
    rows = [line.split(maxsplit=1) for line in out.splitlines() if line.startswith("  ")]
    names = json.loads(run("list", "--json")[1])
    assert dict(rows) == names["models"] | names["excitation"] | names["exports"]
    assert (list(names["models"]), list(names["excitation"])) == (list(CANDIDATES), list(SIGNALS))


def test_no_command_is_cut_in_the_list_of_commands(run):
    _, out, _ = run("--help")
    listed = out.partition("Commands:\n")[2].partition("\n\n")[0].splitlines()
    assert len(listed) == len(app.registered_commands) + len(app.registered_groups)
    assert all(line.endswith(".") and not line.endswith("...") for line in listed)


EMSID = [sys.executable, "-c", "from emsid.cli import main; main()"]


def test_every_command_prints_tracebacks_where_they_are_asked_for():
    groups = [app, *(each.typer_instance for each in app.registered_groups)]
    commands = [each.callback for group in groups for each in group.registered_commands]
    assert {"describe", "fleet", "serve", "run"} <= {each.__name__ for each in commands}
    assert all("debug" in each.__annotations__ for each in commands)


def test_without_a_word_six_lines_say_what_to_do_first(run):
    status, out, err = run()
    assert (status, err, out.count("\n")) == (0, "", 6)
    for line in out.splitlines()[1:]:
        assert run(line.split()[1], "--help")[0] == 0


def test_the_help_of_identify_says_which_models_an_option_is_for_and_that_there_is_no_limit_of_time(run):
    help_ = " ".join(run("identify", "--help")[1].split())
    assert "Time for the whole command, such as 20s; without it there is no limit." in help_
    assert "--orders" not in help_
    help_ = " ".join(run("identify", "--help-all")[1].split())
    assert "Orders of the filters of a cascade, or of a feedback model." in help_
    assert "Static map of a cascade or a feedback model" in help_


def test_the_version_is_printed(run):
    assert run("--version") == (0, f"emsid {emsid.__version__}\n", "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full")
def test_an_output_that_cannot_be_written_is_one_line():
    with open("/dev/full", "w") as full:
        done = subprocess.run([*EMSID, "list"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "emsid: the output cannot be written (no space left on device)\n"


def test_a_terminal_with_few_characters_gets_what_one_types():
    done = subprocess.run([*EMSID, "list"], capture_output=True, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"ohms, kg*m^2 and N*m with intervals" in done.stdout


def test_units_are_shown_as_they_are_printed_and_without_the_signs_for_it_as_they_are_typed(
    motor_log, tmp_path, command, monkeypatch, no_refinements
):
    known = ("--fix", "resistance=2", "--free", "motor_constant,rotor_inertia,rotor_friction.coulomb")
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", *known, "--details", "--out", "out")
    units = {"resistance": ("ohm", "Ω"), "rotor_inertia": ("kg*m^2", "kg·m²"), "rotor_friction.coulomb": ("N*m", "N·m")}
    for k, coding in enumerate(("ascii", "utf-8")):
        printed = io.TextIOWrapper(io.BytesIO(), encoding=coding)
        with monkeypatch.context() as patch:
            patch.chdir(tmp_path)
            patch.setattr(sys, "stdout", printed)
            assert command(*words) == 0
        printed.flush()
        lines = printed.buffer.getvalue().decode(coding).splitlines()
        rows = {name: next(line for line in reversed(lines) if line.startswith(f"{name} ")) for name in units}
        places = {row.index(f" {units[name][k]} ") for name, row in rows.items()}
        assert len(places) == 1  # the columns stand


def test_parameters_are_printed_as_files_that_can_be_edited_and_read_back(run, tmp_path):
    from emsid.io import read_datasheet, read_motor

    path = tmp_path / "printed.toml"
    status, motor, err = run("parameters")
    assert (status, err) == (0, "")
    path.write_text(motor)
    assert asdict(read_motor(path)) == asdict(emsid.Motor())
    status, axis, err = run("parameters", "linear-axis")
    assert (status, err) == (0, "")
    path.write_text(axis.replace('# mass = "unknown"', 'mass = "2 t"'))
    assert {name: given.value for name, given in read_datasheet(path).items()} == {"mass": pytest.approx(2000.0)}
    assert run("parameters", "rigid-motor") == run("parameters", "motor")
    status, out, err = run("parameters", "car")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert all(name in err for name in ("car", "motor", "linear-axis"))


def test_values_may_have_a_unit(run, log, tmp_path):
    plain = run("describe", log, "--input", "u", "--output", "y", "--dt", "0.01")
    for text in ("10ms", "10 ms", "1e4us", "0.01 s", "100Hz", "100 hz", "0.1 kHz"):
        assert run("describe", log, "--input", "u", "--output", "y", "--dt", text) == plain
    for text in ("10 volts", "0 Hz", "Hz", "10 rpm"):
        status, out, err = run("describe", log, "--input", "u", "--output", "y", "--dt", text)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert "invalid value for '--dt'" in err


def test_what_a_file_is_called_is_never_obeyed_by_the_terminal(run, tmp_path):
    from emsid.cli.terminal import harmless

    path = table(tmp_path / "log.csv", **{"[/red]": np.ones(600), "\u202eu": np.ones(600)})
    status, _, err = run("describe", path, "-u", "volts", "-y", "y", "--dt", "1")
    assert status == 2
    assert "[/red]" in err
    assert harmless(err) == err
    words = ("identify", path, "-u", "u", "-y", "y", "--dt", "1", "--models", "arx", "--out", tmp_path / "out")
    assert run(*words)[0] == 0

    from emsid.io import load_model, save

    model = load_model(tmp_path / "out" / "arx.json")
    save(replace(model, structure=replace(model.structure, name="[/red]")), tmp_path / "red.json")
    status, out, _ = run("validate", tmp_path / "red.json", path, "-u", "u", "-y", "y", "--dt", "1")
    assert status == 0
    assert "[/red]" in out


def test_a_simulated_log_says_its_units(run, tmp_path):
    assert run("simulate", "--duration", "2", "--out", tmp_path / "log.csv")[0] == 0
    record = emsid.read(tmp_path / "log.csv", input="voltage", output="speed", time="t")
    assert (record.input_units, record.output_units) == (("V",), ("rad/s",))


def test_json_is_alone_on_standard_output(run, log):
    names = json.loads(run("list", "--json")[1])
    assert set(names["models"]) == set(CANDIDATES)
    (record,) = json.loads(run("describe", log, *IDENTIFY, "--json")[1])["records"]
    assert (record["samples"], record["dt"], [each["name"] for each in record["channels"]]) == (600, 0.01, ["u", "y"])
    table = json.loads(run("parameters", "linear-axis", "--json")[1])
    assert table["plant"] == "linear-axis"
    assert [each["unit"] for each in table["parameters"] if each["name"] == "mass"] == ["kg"]
    assert json.loads(run("parameters", "--json")[1])["parameters"][0]["name"] == "resistance"


def test_orders_prints_the_grid_of_the_library(run, tmp_path):
    path = table(tmp_path / "log.csv")
    words = ("orders", path, "-u", "u", "-y", "y", "--dt", "10ms", "--na", "1-2", "--nb", "1,2", "--nk", "1")
    status, out, err = run(*words, "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    record = emsid.read(path, input="u", output="y", dt=0.01)
    known = emsid.regression.order_grid(record, na=(1, 2), nb=(1, 2), nk=(1,))
    assert [(row["na"], row["nb"], row["constant"]) for row in found["rows"]] == [
        (row.na, row.nb, row.constant) for row in known.rows
    ]
    assert [row["bic"] for row in found["rows"]] == pytest.approx([row.bic for row in known.rows])
    assert set(found["best"]) == {"simplest", "free_run", "bic", "aic", "fpe"}
    assert found["best"]["simplest"]["parameters"] == known.simplest.parameters
    assert run(*words)[1].startswith("8 structures of ARX")
    for text in ("2-1", "x", "1-", ""):
        status, _, err = run(*words, "--na", text)
        assert status != 0
        assert "write whole numbers" in err
