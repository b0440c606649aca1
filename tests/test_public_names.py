"""Public names: each means one thing, every class in a signature is public, and docstrings explain arguments."""

from __future__ import annotations

import ast
import inspect
import re
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import get_args, get_origin, get_type_hints

import numpy as np
import pytest

import emsid


def public_things():
    """Everything that is reached from `emsid` by one or two names: (path, thing)."""
    for name in emsid.__all__:
        thing = getattr(emsid, name)
        if not inspect.ismodule(thing):
            yield name, thing
            continue
        for member in thing.__all__:
            yield f"{name}.{member}", getattr(thing, member)


def signatures(thing):
    """A function, or a class with its public methods and properties, as functions with annotations."""
    if inspect.isroutine(thing):
        yield thing
    elif isinstance(thing, type) and not issubclass(thing, (Exception, Enum)):
        yield thing
        for name, member in vars(thing).items():
            function = (
                getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", member)
            )
            if not name.startswith("_") and inspect.isfunction(function):
                yield function


def classes_in(hint):
    """The classes that an annotation is made of."""
    if isinstance(hint, type) and get_origin(hint) is None:
        yield hint
    elif isinstance(get_origin(hint), type):
        yield get_origin(hint)
    for part in get_args(hint):
        for each in part if isinstance(part, list) else [part]:
            yield from classes_in(each)


# Names that annotations use and that are imported for type checkers only, from other packages.
FOREIGN = {"Figure": object}


def test_every_class_in_a_public_signature_is_public():
    things = dict(public_things())
    public = {id(thing) for thing in things.values()}
    short = {path.split(".")[-1]: thing for path, thing in things.items()} | FOREIGN
    hidden = set()
    for path, thing in things.items():
        for function in signatures(thing):
            try:
                hints = get_type_hints(function, localns=short)
            except NameError as problem:
                hidden.add((path, str(problem)))
                continue
            for hint in hints.values():
                hidden |= {
                    (path, f"{each.__module__}.{each.__name__}")
                    for each in classes_in(hint)
                    if each.__module__.startswith("emsid") and id(each) not in public
                }
    assert hidden == set()


def test_a_public_name_means_one_thing():
    named = {}
    for path, thing in public_things():
        name = path.split(".")[-1]
        if path != "plant.simulate" and name != "register":  # what is simulated or registered says the package's name
            named.setdefault(name, {})[id(thing)] = path
    assert {name: sorted(paths.values()) for name, paths in named.items() if len(paths) > 1} == {}


@pytest.mark.parametrize("name", ["Options", "DeadZone", "Candidate", "Sensor"])
def test_names_that_once_meant_two_things_mean_one_class(name):
    found = {id(thing) for path, thing in public_things() if path.split(".")[-1] == name}
    assert len(found) <= 1


def test_the_dead_zone_that_is_public_is_one_for_cascades():
    cascade = emsid.Cascade((emsid.blocks.DeadZone(-0.1, 0.2),))
    assert cascade.blocks[0].b_r == 0.2
    assert emsid.Cascade(emsid.blocks.DeadZone(-0.1, 0.2)).names == cascade.names
    assert not hasattr(emsid, "DeadZone")
    with pytest.raises(emsid.ModelError, match="no filter and no static map"):
        emsid.Cascade((emsid.DeadZoneLaw(-0.1, 0.2),))


def test_regressors_may_be_a_list_of_texts():
    listed = emsid.Structure.parse(["y(t-1)", "u(t-1)"])
    assert listed == emsid.Structure.parse("y(t-1)", "u(t-1)")
    with pytest.raises(emsid.ModelError, match=r"Structure\.parse"):
        emsid.Structure(("y(t-1)",))
    with pytest.raises(emsid.ModelError, match=r"Structure\.parse"):
        emsid.Structure("y(t-1)")


CALLABLE = [(path, thing) for path, thing in public_things() if "." in path and callable(thing)]
every_callable = pytest.mark.parametrize("thing", [thing for _, thing in CALLABLE], ids=[path for path, _ in CALLABLE])


def documentation(thing):
    """The docstring of a function; of a class that of its parents too."""
    classes = thing.__mro__[:-1] if isinstance(thing, type) else (thing,)
    return "\n".join(each.__doc__ or "" for each in classes if not (each.__doc__ or "").startswith(f"{each.__name__}("))


@every_callable
def test_a_public_docstring_explains_every_argument(thing):
    text = documentation(thing)
    assert len(text) > 15
    plain = isinstance(thing, type) and issubclass(thing, (Exception, Enum, dict))
    plain = plain or getattr(thing, "_is_protocol", False)
    names = [] if plain else [name for name in inspect.signature(thing).parameters if name != "self"]
    words = {"path": "path|file", "records": "records|experiments"}
    assert [n for n in names if not re.search(rf"\b({words.get(n, n)})\b", text, re.IGNORECASE)] == []


@every_callable
def test_a_public_function_says_what_it_raises(thing):
    if inspect.isfunction(thing):
        raised = set(re.findall(r"\braise (\w+Error)\b", inspect.getsource(thing)))
        assert [error for error in raised if error not in (thing.__doc__ or "").partition("Raises:")[2]] == []


OLD = [("emsid", old, now) for old, now in emsid.RENAMED.items()]
OLD += [("emsid.validation", "assess", "validate")]


@pytest.mark.parametrize(("module", "old", "now"), OLD)
def test_an_old_name_is_the_present_thing_with_a_warning(module, old, now):
    place = import_module(module)
    with pytest.warns(DeprecationWarning, match=rf"{module}\.{old} is now {module}\.{now}"):
        thing = getattr(place, old)
    assert thing is getattr(place, now)
    assert old not in dir(place)
    assert thing.__name__ == now


@pytest.mark.parametrize("module", ["emsid", "emsid.plants", "emsid.regression", "emsid.validation"])
def test_a_name_that_never_was_is_refused(module):
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = import_module(module).no_such_name


def test_one_model_is_validated_with_or_without_its_fit():
    u = np.sin(np.arange(300.0) ** 1.2)
    record = emsid.Record(u, np.convolve(u, [0.0, 0.5, 0.2])[:300], 0.01)
    fit = emsid.fit(emsid.arx(na=1, nb=2), record)
    errors = [emsid.validate(each, record).row.simulation_mse for each in (fit, fit.model)]
    assert errors[0] == errors[1]


def test_the_inertia_of_a_rotor_says_that_it_has_the_load():
    parameter = next(each for each in emsid.Motor().parameters() if each.name == "rotor_inertia")
    assert "with the load" in parameter.description


@pytest.mark.parametrize("script", sorted(Path(__file__).parents[1].glob("bench/*.py")), ids=lambda path: path.stem)
def test_what_a_bench_imports_exists(script):
    """No check of types reads the benches, and nothing else runs them."""
    for node in ast.walk(ast.parse(script.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("emsid"):
            module = import_module(node.module)
            for each in node.names:
                assert hasattr(module, each.name) or import_module(f"{node.module}.{each.name}"), each.name
