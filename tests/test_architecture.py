"""The rules of the house: who may know whom, who may do what, and that everything public explains itself."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from enum import Enum
from functools import cache
from pathlib import Path

import pytest

import emsid

HOME = Path(emsid.__file__).parent

# Imports point to earlier layers only.
LAYERS = (
    {"errors", "findings", "units"},
    {"record", "wording"},
    {"excitation", "plant", "estimation"},
    {"models"},
    {"selection", "validation"},
    {"io", "report", "live"},
    {"identification", "study"},
    {"cli"},
    {"__main__"},
)
# Within a layer a room knows itself, and besides:
NEIGHBOURS = {
    "units": {"errors"},
    "report": {"io.files"},
    "study": {"identification"},
}
LEVEL = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}

SOURCES = {path.relative_to(HOME).with_suffix("").as_posix().replace("/", "."): path for path in HOME.rglob("*.py")}
MODULES = sorted(name for name in SOURCES if name != "__init__")
every_module = pytest.mark.parametrize("module", MODULES)


@cache
def tree_of(module: str) -> ast.Module:
    return ast.parse(SOURCES[module].read_text("utf-8"))


def imports(tree: ast.Module) -> Iterator[str]:
    """Every module that is imported anywhere, ``from a import b`` as ``a.b``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def calls(tree: ast.AST) -> Iterator[str]:
    """Every function that is called, as it is written."""
    yield from (ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call))


def forbidden(module: str, target: str) -> bool:
    """Whether a module of the package may not import ``target``, another one."""
    room, other = module.split(".")[0], target.split(".")[0]
    if other not in LEVEL:
        return True  # a name of the top level: only users take the short way
    if room == other or LEVEL[other] < LEVEL[room]:
        return False
    known = NEIGHBOURS.get(room, set())
    return LEVEL[other] > LEVEL[room] or not any(target == k or target.startswith(f"{k}.") for k in known)


# --- who may know whom -----------------------------------------------------------------------------------------------


def test_every_room_has_its_place() -> None:
    assert {module.split(".")[0] for module in MODULES} <= set(LEVEL)


@every_module
def test_imports_point_to_earlier_layers_only(module: str) -> None:
    own = [name.removeprefix("emsid.") for name in imports(tree_of(module)) if name.split(".")[0] == "emsid"]
    assert [target for target in own if forbidden(module, target)] == []


@pytest.mark.parametrize(
    ("module", "target", "wrong"),
    [
        ("estimation.fit", "models.model.Model", True),
        ("estimation.fit", "plant.Motor", True),
        ("estimation.fit", "estimation.information", False),
        ("models.narx", "estimation.fit", False),
        ("models.narx", "validation.metrics", True),
        ("report.page", "io.files.atomic_write", False),
        ("report.page", "io.reading.read", True),
        ("io.files", "report.page", True),
        ("record.record", "units.conversion", False),
        ("plant.motor", "Record", True),
        ("study.workflow", "cli", True),
    ],
)
def test_the_rule_itself(module: str, target: str, wrong: bool) -> None:
    assert forbidden(module, target) is wrong


# --- who may do what -------------------------------------------------------------------------------------------------


@every_module
@pytest.mark.parametrize(
    ("packages", "allowed"),
    [
        ({"matplotlib"}, r"report\.figures"),
        ({"plotly"}, r"report\.page_plots"),
        ({"typer", "click"}, r"cli\..*"),
        ({"rich"}, r"cli\.terminal"),
        ({"h5py", "polars", "tempfile", "shutil"}, r"io\..*"),
        ({"pickle", "marshal", "shelve", "dill", "joblib"}, r""),
    ],
    ids=["printed plots", "plots of the page", "command line", "terminal", "file formats", "pickle"],
)
def test_only_one_place_imports(module: str, packages: set[str], allowed: str) -> None:
    found = {name for name in imports(tree_of(module)) if name.split(".")[0] in packages or name in packages}
    assert not found or re.fullmatch(allowed, module), f"{module} imports {found}"


OPENS = re.compile(
    r"open|(.*\.)?(open|read_text|write_text|read_bytes|write_bytes|unlink|mkdir|touch|rename)|os\.(replace|remove)|"
    r"(np|numpy)\.(load|save|savez|savez_compressed|loadtxt|savetxt|genfromtxt|fromfile|memmap)|.*\.tofile"
)


@every_module
def test_only_io_touches_files(module: str) -> None:
    found = [name for name in calls(tree_of(module)) if OPENS.fullmatch(name)]
    assert module.startswith("io") or found == []


@every_module
def test_no_text_is_ever_executed(module: str) -> None:
    tree = tree_of(module)
    assert {"eval", "exec", "compile", "__import__"}.isdisjoint(calls(tree))
    named = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and ast.unparse(n.func).endswith("import_module")]
    assert all(isinstance(call.args[0], ast.Constant) for call in named)  # nothing that a file could name


@pytest.mark.parametrize(
    "command",
    [
        "import emsid",
        "import sys; sys.argv = ['emsid', '--help']\nfrom emsid.cli import main\nmain()",
    ],
    ids=["import", "help"],
)
def test_start_is_fast_because_nothing_heavy_is_imported(command: str) -> None:
    heavy = {"numba", "llvmlite", "scipy", "matplotlib", "plotly", "polars", "h5py", "pint", "jinja2"}
    at_the_end = f"import atexit, sys\natexit.register(lambda: print('LOADED', {heavy} & sys.modules.keys()))\n"
    program = [sys.executable, "-c", at_the_end + command]
    done = subprocess.run(program, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines()[-1] == "LOADED set()"


@cache
def compiled(module: str) -> dict[str, str]:
    """The compiled functions of a module and what they return."""
    functions = [node for node in ast.walk(tree_of(module)) if isinstance(node, ast.FunctionDef)]
    return {
        f.name: ast.unparse(f.returns) if f.returns else "?"
        for f in functions
        if any(re.search(r"njit|_kernel", ast.unparse(decorator)) for decorator in f.decorator_list)
    }


@every_module
def test_compiled_code_returns_numbers_only_to_python(module: str) -> None:
    """Ctrl-C while it makes arrays of its own into objects would end the interpreter."""
    kernels = {name: kind for each in MODULES for name, kind in compiled(each).items()}
    unsafe = {name for name, kind in kernels.items() if kind not in ("None", "int", "float", "bool")}
    functions = [node for node in ast.walk(tree_of(module)) if isinstance(node, ast.FunctionDef)]
    callers = [f for f in functions if f.name not in kernels]
    assert unsafe.isdisjoint(name for f in callers for name in calls(f))


# --- everything public explains itself -------------------------------------------------------------------------------


STUB = ast.parse((HOME / "__init__.pyi").read_text("utf-8"))
PUBLIC = sorted(
    alias.asname for node in STUB.body if isinstance(node, ast.ImportFrom) for alias in node.names if alias.asname
)
every_name = pytest.mark.parametrize("name", PUBLIC)


# A parameter may be explained by another word for it.
WORDS = {"path": "path|file", "records": "records|experiments"}


def parameters(thing: object) -> list[str]:
    """What is given to a function, or to a class to make a value of it."""
    if isinstance(thing, type) and (issubclass(thing, (Exception, Enum)) or getattr(thing, "_is_protocol", False)):
        return []
    return [name for name in inspect.signature(thing).parameters if name != "self"]  # type: ignore[arg-type]


def test_names_of_the_stub_are_the_names_of_the_package() -> None:
    assert len(PUBLIC) > 20
    assert sorted(emsid.__all__) == PUBLIC
    assert set(PUBLIC) <= set(dir(emsid))
    with pytest.raises(AttributeError):
        _ = emsid.no_such_thing


@every_name
def test_public_names_resolve_to_what_they_are_called(name: str) -> None:
    assert getattr(emsid, name).__name__ == name


@every_name
def test_docstring_mentions_every_parameter(name: str) -> None:
    thing = getattr(emsid, name)
    text = thing.__doc__ or ""
    assert len(text) > 15
    assert not text.startswith(f"{name}(")  # what dataclass writes by itself
    silent = [p for p in parameters(thing) if not re.search(rf"\b({WORDS.get(p, p)})\b", text, re.IGNORECASE)]
    assert silent == []


@every_name
def test_docstring_of_a_function_says_what_it_raises(name: str) -> None:
    thing = getattr(emsid, name)
    if inspect.isfunction(thing):
        raised = set(re.findall(r"\braise (\w+Error)\b", inspect.getsource(thing)))
        assert [error for error in raised if error not in (thing.__doc__ or "").partition("Raises:")[2]] == []


@every_name
def test_public_methods_have_docstrings(name: str) -> None:
    thing = getattr(emsid, name)
    members = vars(thing).items() if isinstance(thing, type) else ()
    silent = [
        member
        for member, value in members
        if not member.startswith("_")
        and (inspect.isroutine(value) or isinstance(value, property))
        and not inspect.getdoc(value)
    ]
    assert silent == []


@every_module
def test_modules_say_what_they_are(module: str) -> None:
    tree = tree_of(module)
    assert ast.get_docstring(tree) or not tree.body  # an empty __init__ has nothing to say
