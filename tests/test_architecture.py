"""The rules of the source tree: who may know whom, who may do what, and that everything public explains itself."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from functools import cache
from pathlib import Path

import pytest

import emsid
from source_tree import nodes_of

HOME = Path(emsid.__file__).parent
SOURCES = {
    path.relative_to(HOME).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__"): path
    for path in HOME.rglob("*.py")
}
MODULES = sorted(name for name in SOURCES if name != "__init__")

# --- who may know whom -----------------------------------------------------------------------------------------------

# A module imports from its own package and from those on earlier lines, nothing else.
LAYERS = (
    {"arguments", "compiled", "errors"},
    {"findings", "presentation", "renamed", "replacing", "units"},
    {"record", "wording"},
    {"excitation", "plant", "estimation", "selection"},  # selection compares numbers and knows no model
    {"models"},
    {"options", "validation"},
    {"io", "live"},
    {"exports"},
    {"compensation", "experiment_design"},  # what is done with a model
    {"controllers"},
    {"first_look"},  # what a file holds, before anything is identified
    {"identification"},
    {"study"},
    {"report"},
    {"fleets", "studio", "sklearn"},
    {"cli"},
    {"__main__"},
    {"blocks", "linear", "plants", "regression"},  # public faces, see below
)
LEVEL = {package: level for level, packages in enumerate(LAYERS) for package in packages}

# Inside a package: a part (left) knows nothing of its siblings (right).
STRANGERS = {
    "estimation.linear": ("estimation.nonlinear", "estimation.uncertainty"),
    "models.capabilities": ("models.regression", "models.blocks", "models.feedback", "models.plants"),
    "models.model": ("models.regression", "models.blocks", "models.feedback", "models.plants"),
    "models.free_run": ("models.regression", "models.blocks", "models.feedback", "models.plants"),
    "models.extrapolation": ("models.regression", "models.blocks", "models.feedback", "models.plants"),
    "models.terms": ("models.regression", "models.blocks", "models.feedback", "models.plants"),
    "models.regression": ("models.blocks", "models.feedback", "models.plants"),
    "models.linear": ("models.blocks", "models.feedback", "models.plants"),
    "models.blocks": ("models.feedback", "models.plants"),
    "models.feedback": ("models.plants",),
    "models.blocks.static_maps": ("models.regression", "models.blocks", "models.feedback"),
    "models.plants": ("models.regression", "models.blocks", "models.feedback"),
}
# A search fits a model; the model does not know it. Besides itself, a search is known to these only.
SEARCHES = ("models.regression.search", "models.blocks.search", "models.feedback.search", "models.plants.search")
SEARCHERS = (
    "models.feedback.search",
    "models.blocks.capabilities",
    "models.feedback.capabilities",
    "models.plants.capabilities",
    "models.verbs",
    "options",
    "identification",
    "study",
    "report",
    "studio",
    "cli",
    "blocks",
    "plants",
    "regression",
)
# What users reach as `emsid.blocks` and so on: modules that pass on names of `models` and define nothing. They stand at
# the end of the layers, so no module of the package can import them.
FACES = ("blocks", "linear", "plants", "regression")


def nodes(module: str) -> tuple[ast.AST, ...]:
    return nodes_of(SOURCES[module])


@cache
def imports(module: str) -> tuple[str, ...]:
    """Every module that is imported anywhere, ``from a import b`` as ``a.b``."""
    return tuple(_imports(module))


def _imports(module: str) -> Iterator[str]:
    for node in nodes(module):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def own_imports(module: str) -> frozenset[str]:
    """What a module imports from the package, as modules of it where there are such."""
    names = (name.removeprefix("emsid.") for name in imports(module) if name.startswith("emsid."))
    return frozenset(
        name if name in SOURCES or name.rpartition(".")[0] not in SOURCES else name.rpartition(".")[0] for name in names
    )


def within(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def forbidden(module: str, target: str) -> bool:
    """Whether a module of the package may not import ``target``, another one."""
    package, other = module.split(".")[0], target.split(".")[0]
    if other not in LEVEL or LEVEL[other] > LEVEL[package] or (LEVEL[other] == LEVEL[package] and other != package):
        return True
    strangers = [
        stranger
        for part, siblings in STRANGERS.items()
        if within(module, part) and not within(target, part)
        for stranger in siblings
    ]
    search = next((each for each in SEARCHES if within(target, each)), module)
    hidden = not any(within(module, each) for each in (search, *SEARCHERS))
    return hidden or any(within(target, stranger) for stranger in strangers)


@pytest.mark.parametrize("face", FACES)
def test_a_public_face_passes_on_names_of_the_models_and_defines_nothing(face: str) -> None:
    assert all(target.startswith(("models.", "plant.")) for target in own_imports(face))
    assert not [node for node in nodes(face) if isinstance(node, ast.FunctionDef | ast.ClassDef)]


def test_every_package_has_its_layer() -> None:
    assert {module.split(".")[0] for module in MODULES} <= set(LEVEL)


def test_imports_point_to_earlier_layers_only() -> None:
    wrong = {(module, target) for module in MODULES for target in own_imports(module) if forbidden(module, target)}
    assert wrong == set()


@pytest.mark.parametrize(
    ("module", "target", "wrong"),
    [
        ("estimation.fit", "models.model", True),
        ("estimation.fit", "plant.motor", True),
        ("estimation.fit", "estimation.linear.information", False),
        ("estimation.linear.recursive", "estimation.nonlinear.problem", True),
        ("estimation.linear.recursive", "estimation.fit", False),
        ("models.regression.narx", "estimation.fit", False),
        ("models.regression.narx", "validation.metrics", True),
        ("models.regression.narx", "models.blocks.cascade", True),
        ("models.blocks.search.starts", "models.regression.structures", False),
        ("models.blocks.search.starts", "models.plants.drive", True),
        ("models.blocks.static_maps.laws", "models.blocks.cascade", True),
        ("models.blocks.static_maps.laws", "models.blocks.static_maps.static_map", False),
        ("models.blocks.cascade", "models.blocks.search.orders", True),
        ("models.blocks.search.choice", "models.blocks.search.orders", False),
        ("models.model", "models.regression.narx", True),
        ("models", "models.regression.narx", False),
        ("validation.comparison", "models.plants.search.task", True),
        ("identification.workflow", "models.plants.search.choice", False),
        ("report.page", "identification.workflow", False),
        ("report.page", "io.files", False),
        ("identification.workflow", "report.page", True),
        ("io.files", "report.page", True),
        ("selection.order", "validation.metrics", True),
        ("record.record", "units", False),
        ("plant.motor", "Record", True),
        ("live.session", "io.files", True),
        ("live.session", "models.regression.figures", False),
        ("estimation.linear.adaptation", "live.session", True),
        ("report.tracking_page", "live.session", False),
        ("study.workflow", "cli", True),
        ("study.workflow", "identification.workflow", False),
    ],
)
def test_the_rule_itself(module: str, target: str, wrong: bool) -> None:
    assert forbidden(module, target) is wrong


def cycles(known: dict[str, set[str]]) -> list[list[str]]:
    """Groups in which every member is reached from every other (Tarjan, SIAM J. Comput. 1, 1972)."""
    found: list[list[str]] = []
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []

    def visit(module: str) -> None:
        number[module] = lowest[module] = len(number)
        stack.append(module)
        for target in sorted(known[module]):
            if target not in number:
                visit(target)
                lowest[module] = min(lowest[module], lowest[target])
            elif target in stack:
                lowest[module] = min(lowest[module], number[target])
        if lowest[module] == number[module]:
            group = stack[stack.index(module) :]
            del stack[-len(group) :]
            if len(group) > 1:
                found.append(sorted(group))

    for module in sorted(known):
        if module not in number:
            visit(module)
    return sorted(found)


def test_no_module_imports_itself_by_a_detour() -> None:
    assert cycles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a", "c"}}) == [["b", "c"]]
    assert cycles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []
    known = {module: (own_imports(module) & SOURCES.keys()) - {module} for module in MODULES}
    assert cycles(known) == []


@pytest.mark.parametrize("module", MODULES)
def test_a_constant_has_one_value(module: str) -> None:
    targets = [
        target
        for node in ast.parse(SOURCES[module].read_text("utf-8")).body
        for target in (node.targets if isinstance(node, ast.Assign) else ())
    ]
    names = [target.id for target in targets if isinstance(target, ast.Name) and target.id.isupper()]
    assert len(names) == len(set(names)), names


# --- who may do what -------------------------------------------------------------------------------------------------


@cache
def calls(module: str) -> tuple[str, ...]:
    """Every function that a module calls, as it is written."""
    return tuple(called(nodes(module)))


def called(among: Iterable[ast.AST]) -> Iterator[str]:
    yield from (ast.unparse(node.func) for node in among if isinstance(node, ast.Call))


def offenders(found: Callable[[str], object]) -> dict[str, object]:
    """The modules in which something is found, and what."""
    return {module: what for module in MODULES if (what := found(module))}


@pytest.mark.parametrize(
    ("packages", "allowed"),
    [
        ({"matplotlib"}, r"report\.figures|presentation|report\.notebook"),  # the last two name its type only
        ({"typer", "click"}, r"cli(\..*)?"),
        ({"rich"}, r"cli\.(terminal|live_view)"),
        ({"serial", "socket", "selectors", "select"}, r"(live|studio)(\..*)?"),
        ({"h5py", "polars"}, r"(io|fleets)(\..*)?"),
        ({"tempfile", "shutil"}, r"(io|exports|fleets|studio)(\..*)?|live\.log"),
        ({"pickle", "marshal", "shelve", "dill", "joblib"}, r""),
    ],
    ids=["printed plots", "command line", "terminal", "connections", "file formats", "temporary files", "pickle"],
)
def test_only_one_place_imports(packages: set[str], allowed: str) -> None:
    def found(module: str) -> set[str]:
        return {name for name in imports(module) if name.split(".")[0] in packages}

    assert {module: names for module, names in offenders(found).items() if not re.fullmatch(allowed, module)} == {}


OPENS = re.compile(
    r"open|(.*\.)?(open|read_text|write_text|read_bytes|write_bytes|unlink|mkdir|touch|rename)|os\.(replace|remove)|"
    r"(np|numpy)\.(load|save|savez|savez_compressed|loadtxt|savetxt|genfromtxt|fromfile|memmap)|.*\.tofile"
)


DOORS = ("io", "live", "exports", "fleets", "studio")


def test_only_the_doors_touch_files() -> None:
    found = offenders(lambda module: [name for name in calls(module) if OPENS.fullmatch(name)])
    made = [ast.unparse(node) for node in nodes("__main__") if isinstance(node, ast.Call)]
    assert [each for each in made if "open(" in each] == ["os.open(os.devnull, os.O_RDWR)"]  # for closed streams
    assert [module for module in found if not any(within(module, each) for each in (*DOORS, "__main__"))] == []


def test_kernels_are_compiled_where_nothing_can_be_kept_too() -> None:
    """`numba.njit` with a cache raises an error of its own where no folder can be written to."""
    found = offenders(lambda module: [name for name in imports(module) if name in ("numba", "numba.njit")])
    assert sorted(found) == ["compiled"]


def test_no_text_is_ever_executed() -> None:
    executed = {"eval", "exec", "compile", "__import__"}
    assert offenders(lambda module: executed & set(calls(module))) == {}

    def named_by_data(module: str) -> list[str]:
        """Imports of a module whose name is not written there: a file could name it."""
        made = [node for node in nodes(module) if isinstance(node, ast.Call)]
        imported = [node for node in made if ast.unparse(node.func).endswith("import_module")]
        return [ast.unparse(node) for node in imported if not isinstance(node.args[0], ast.Constant)]

    assert offenders(named_by_data) == {}


def test_only_the_command_line_knows_of_ctrl_c() -> None:
    """A search looks at its `Control` between steps; the signal becomes `Control.cancelled` in the command line."""

    def found(module: str) -> bool:
        return any(isinstance(node, ast.Name) and node.id == "KeyboardInterrupt" for node in nodes(module))

    assert [module for module in offenders(found) if not (within(module, "cli") or module == "__main__")] == []


OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")


def texts(module: str) -> Iterator[str]:
    """Every string of a module that is no documentation."""
    silent = {id(node.value) for node in nodes(module) if isinstance(node, ast.Expr)}
    for node in nodes(module):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
            yield node.value


def test_only_the_command_line_spells_options() -> None:
    found = offenders(lambda module: [name for text in texts(module) for name in OPTION.findall(text)])
    assert {module: names for module, names in found.items() if not within(module, "cli")} == {}


PLANTS = {"Motor", "DrivenMotor", "LinearAxis", "OwnPlant"}


def test_nobody_asks_for_the_type_or_the_name_of_a_plant() -> None:
    """A plant declares what others need to know, so that another plant needs no further code."""

    def found(module: str) -> list[str]:
        questions = []
        for node in nodes(module):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass"):
                asked = {each.id for each in ast.walk(node.args[1]) if isinstance(each, ast.Name)}
                questions += [ast.unparse(node)] if asked & PLANTS else []
            elif isinstance(node, ast.Compare) and ast.unparse(node.left).endswith("plant.name"):
                questions.append(ast.unparse(node))
        return questions

    assert [module for module in offenders(found) if not within(module, "models.plants")] == []


# What is no kind of model, or only tells a model from what is none, such as arguments in the wrong order.
NO_KIND = {"models.model.Model", "models.linear.system.LinearSystem", "models.plants.datasheet.Given"}


def test_only_the_models_ask_for_the_kind_of_a_model() -> None:
    """All others ask what it can do (`emsid.models.capabilities`), so that another kind needs its own files only."""

    def found(module: str) -> list[str]:
        models = {name.rpartition(".")[2] for name in imports(module) if name.startswith("emsid.models.")}
        models -= {name.rpartition(".")[2] for name in NO_KIND}
        questions = []
        for node in nodes(module):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass"):
                asked = {each.id for each in ast.walk(node.args[1]) if isinstance(each, ast.Name)}
                questions += [ast.unparse(node)] if asked & models else []
            elif isinstance(node, ast.Attribute) and node.attr == "__mro__":
                questions.append(ast.unparse(node))
        return questions

    assert {module: asked for module, asked in offenders(found).items() if not within(module, "models")} == {}


@pytest.mark.parametrize(
    "command",
    [
        'import emsid; assert {"fit", "plants", "blocks"} <= set(dir(emsid))',
        "import sys; sys.argv = ['emsid', '--help']\nfrom emsid.cli import main\nmain()",
    ],
    ids=["import", "help"],
)
def test_start_is_fast_because_nothing_heavy_is_imported(command: str) -> None:
    heavy = {"numba", "llvmlite", "scipy", "matplotlib", "polars", "h5py", "pint", "jinja2"}
    at_the_end = f"import atexit, sys\natexit.register(lambda: print('LOADED', {heavy} & sys.modules.keys()))\n"
    program = [sys.executable, "-c", at_the_end + command]
    done = subprocess.run(program, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines()[-1] == "LOADED set()"


def compiled(module: str) -> dict[str, str]:
    """The compiled functions of a module and what they return."""
    functions = [node for node in nodes(module) if isinstance(node, ast.FunctionDef)]
    return {
        f.name: ast.unparse(f.returns) if f.returns else "?"
        for f in functions
        if any(re.search(r"njit|_kernel", ast.unparse(decorator)) for decorator in f.decorator_list)
    }


def test_compiled_code_returns_numbers_only_to_python() -> None:
    """Ctrl-C while it makes arrays of its own into objects would end the interpreter."""
    kernels = {name: kind for module in MODULES for name, kind in compiled(module).items()}
    unsafe = {name for name, kind in kernels.items() if kind not in ("None", "int", "float", "bool")}

    def found(module: str) -> set[str]:
        functions = [node for node in nodes(module) if isinstance(node, ast.FunctionDef)]
        return {name for f in functions if f.name not in kernels for name in called(ast.walk(f))} & unsafe

    assert offenders(found) == {}


# --- everything public explains itself -------------------------------------------------------------------------------


STUB = [node for node in ast.parse((HOME / "__init__.pyi").read_text("utf-8")).body if isinstance(node, ast.ImportFrom)]
PUBLIC = sorted(alias.asname for node in STUB if node.module for alias in node.names if alias.asname)
NAMESPACES = sorted(alias.name for node in STUB if not node.module for alias in node.names)
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
    assert sorted(emsid.__all__) == sorted(PUBLIC + NAMESPACES)
    assert set(emsid.__all__) <= set(dir(emsid))
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


def test_modules_say_what_they_are() -> None:
    """All but an empty ``__init__``, which has nothing to say."""

    def silent(module: str) -> bool:
        tree = nodes(module)[0]
        return isinstance(tree, ast.Module) and bool(tree.body) and not ast.get_docstring(tree)

    assert offenders(silent) == {}
