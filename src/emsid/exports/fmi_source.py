"""The C source of an FMU: the functions of FMI 3.0 or 2.0 around ``NAME_init`` and ``NAME_step``.

An instance holds the state of the model before sample k, the input, and the time. ``DoStep`` passes the samples
that its time contains; a sample takes the input that was set when it began. An output is what the step of the present
sample gives, from a copy of the state, so that it follows the input at once where the model has a direct path.

The two standards declare 75 and 44 functions. `FMI3` and `FMI2` list their arguments; those without a body here belong
to other kinds of FMU or to types without variables, and refuse. The types are those of the standards, written as the
types of C that they stand for.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from emsid.exports.formats import Export

CORE = """\
#define JOIN_NOW(a, b) a##b
#define JOIN(a, b) JOIN_NOW(a, b)
#define NAMED(name) JOIN(PREFIX, name)
#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

enum { OK = 0, DISCARD = 2, ERROR = 3 };

/* What a simulation is at a time. */
typedef struct {
    MODEL_state model; /* before the present sample */
    double u[INPUTS];  /* as it was set */
    double held[INPUTS]; /* of the present sample, once it has begun */
    double p[PARAMETERS + 1];
    double start;
    double time;
    double sample; /* number of the present sample */
    int begun;
} Moment;

typedef struct {
    Moment now;
    LOGGER log;
    void *environment;
} Instance;

/* The parameters first. */
static const double constants[CONSTANTS + 1] = {VALUES};
static const double low[PARAMETERS + 1] = {LOW};
static const double high[PARAMETERS + 1] = {HIGH};

static int complain(const Instance *it, const char *text)
{
    if (it->log) {
        LOG;
    }
    return ERROR;
}

static void restart(Moment *now)
{
    static const Moment empty;
    *now = empty;
    memcpy(now->p, constants, PARAMETERS * sizeof *constants);
    MODEL_init(&now->model);
}

static Instance *made(const char *token, LOGGER log, void *environment)
{
    Instance *it = malloc(sizeof *it);
    if (it) {
        it->log = log;
        it->environment = environment;
        restart(&it->now);
        if (!token || strcmp(token, TOKEN) != 0) {
            complain(it, "the token is not that of this model");
            free(it);
            it = NULL;
        }
    }
    return it;
}

static int get(const Instance *it, const unsigned int references[], size_t count, double values[])
{
    double y[OUTPUTS];
    MODEL_state copy = it->now.model;
    size_t k;
    MODEL_step(&copy, it->now.begun ? it->now.held : it->now.u, y);
    for (k = 0; k < count; ++k) {
        const unsigned int one = references[k];
        if (one == 0) {
            values[k] = it->now.time;
        } else if (one <= INPUTS) {
            values[k] = it->now.u[one - 1];
        } else if (one <= INPUTS + OUTPUTS) {
            values[k] = y[one - INPUTS - 1];
        } else if (one <= INPUTS + OUTPUTS + PARAMETERS) {
            values[k] = it->now.p[one - INPUTS - OUTPUTS - 1];
        } else if (one <= INPUTS + OUTPUTS + CONSTANTS) {
            values[k] = constants[one - INPUTS - OUTPUTS - 1];
        } else {
            return complain(it, "there is no variable of this reference");
        }
    }
    return OK;
}

static int set(Instance *it, const unsigned int references[], size_t count, const double values[])
{
    const size_t parameters = PARAMETERS;
    size_t k;
    for (k = 0; k < count; ++k) {
        const unsigned int one = references[k], place = one - INPUTS - OUTPUTS - 1;
        if (one >= 1 && one <= INPUTS) {
            it->now.u[one - 1] = values[k];
        } else if (one <= INPUTS + OUTPUTS || place >= parameters) {
            return complain(it, "only inputs and parameters can be set");
        } else if (it->now.begun || !(values[k] >= low[place] && values[k] <= high[place])) {
            return complain(it, "a parameter is within its bounds and is set before the first step");
        } else {
            it->now.p[place] = values[k];
            SET;
        }
    }
    return OK;
}

static int advance(Instance *it, double from, double length)
{
    Moment *now = &it->now;
    const double end = from + length;
    double y[OUTPUTS];
    if (!(length >= 0.0) || !(fabs(from - now->time) <= SLACK)) {
        return complain(it, "a step must begin where the last one ended");
    }
    if (!now->begun) {
        memcpy(now->held, now->u, sizeof now->held);
    }
    now->begun = 1;
    while (now->start + (now->sample + 1.0) * STEP <= end + SLACK) {
        MODEL_step(&now->model, now->held, y);
        now->sample += 1.0;
        memcpy(now->held, now->u, sizeof now->held);
        now->begun = now->start + now->sample * STEP < end - SLACK;
    }
    now->time = end;
    return OK;
}

static int keep(const Instance *it, void **state)
{
    if (!*state) {
        *state = malloc(sizeof(Moment));
    }
    if (!*state) {
        return complain(it, "there is no memory left");
    }
    memcpy(*state, &it->now, sizeof(Moment));
    return OK;
}

static int fill(const Instance *it, const void *from, void *to, size_t size)
{
    if (size != sizeof(Moment)) {
        return complain(it, "this is no state of this model");
    }
    memcpy(to, from, size);
    return OK;
}
"""
"""What both standards need. Capitals stand for the numbers and names of a model."""

LOGGERS = {
    "3.0": (
        "typedef void (*LOGGER)(void *environment, int status, const char *category, const char *message);",
        'it->log(it->environment, ERROR, "logStatusError", text)',
    ),
    "2.0": (
        "typedef void (*LOGGER)(void *environment, const char *instance, int status, const char *category, "
        "const char *message, ...);\n\ntypedef struct {\n    LOGGER log;\n"
        "    void *(*allocate)(size_t count, size_t size);\n"
        "    void (*release)(void *memory);\n    void (*finished)(void *environment, int status);\n"
        "    void *environment;\n} Callbacks;",
        'it->log(it->environment, MODEL_NAME, ERROR, "logStatusError", "%s", text)',
    ),
}
"""The logger of each standard, and a call of it."""

ME, MY = "void *it", "    Instance *mine = it;\n"
REFERENCES = f"{ME}, const unsigned int references[], size_t count"
STEPPED = "    restart(&mine->now);\n    return OK;\n"
BEGIN = "    mine->now.start = start;\n    mine->now.time = start;\n    return OK;\n"
STATES = {
    "Get": (f"{ME}, void **state", "    return keep(it, state);\n"),
    "Set": (f"{ME}, void *state", f"{MY}    return fill(it, state, &mine->now, sizeof(Moment));\n"),
    "Free": (
        f"{ME}, void **state",
        "    (void)it;\n    if (state) {\n        free(*state);\n        *state = NULL;\n    }\n    return OK;\n",
    ),
    "Size": (f"{ME}, void *state, size_t *size", "    *size = sizeof(Moment);\n    return OK;\n"),
    "Pack": (f"{ME}, void *state, BYTE bytes[], size_t size", "    return fill(it, state, bytes, size);\n"),
    "Unpack": (
        f"{ME}, const BYTE bytes[], size_t size, void **state",
        "    const int kept = keep(it, state);\n    return kept != OK ? kept : fill(it, bytes, *state, size);\n",
    ),
}
"""Getting and setting of the state of an instance, alike in both standards."""

INSTANCE3 = "const char *name, const char *token, const char *resources, bool visible, bool logging"
FUNCTIONS = tuple[str, str, str | None]
"""Type and name of a function, its arguments, and its body, or None for one that refuses."""

NOTHING = '    return count ? complain(it, "there are no variables of this type") : OK;\n'
ENDS3 = "bool *again, bool *end, bool *nominals, bool *states, bool *event, double *next"
KNOWN = "const unsigned int unknowns[], size_t unknown, const unsigned int knowns[], size_t known"
SEEDS3 = "const double seed[], size_t seeds, double result[], size_t results"
FRACTIONS = "uint64_t counters[], {0}uint64_t resolutions[]"
EMPTY = "    *size = 0;\n    return OK;\n"
LOG3 = "void *environment, LOGGER log"
LOCKS = "void (*lock)(void), void (*unlock)(void)"
SPAN = "{0} tolerant, double tolerance, double start, {0} stops, double stop"
TAKEN = (
    f"{MY}    const int done = advance(mine, from, length);\n    *event = false;\n    *end = false;\n"
    "    *early = false;\n    *reached = mine->now.time;\n    return done;\n"
)
REAL_STATUS = f"{MY}    *value = mine->now.time;\n    return kind == 2 ? OK : DISCARD;\n"
VALUES3 = (
    *(("Float32", "float"), ("Float64", "double"), ("Int8", "int8_t"), ("UInt8", "uint8_t")),
    *(("Int16", "int16_t"), ("UInt16", "uint16_t"), ("Int32", "int32_t"), ("UInt32", "uint32_t")),
    *(("Int64", "int64_t"), ("UInt64", "uint64_t"), ("Boolean", "bool"), ("String", "const char *")),
)
VALUES2 = (("Real", "double"), ("Integer", "int"), ("Boolean", "int"), ("String", "const char *"))


def _access(number: int) -> Iterator[FUNCTIONS]:
    """The functions that get and set values of each type."""
    size, real = (", size_t size", "Float64") if number == 3 else ("", "Real")
    for way, constant in (("Get", ""), ("Set", "const ")):
        for kind, c in VALUES3 if number == 3 else VALUES2:
            text = c.endswith("*")
            array = f"{c}const values[]" if constant and text else f"{constant}{c}{'' if text else ' '}values[]"
            check = "size != count ? ERROR : " if size else ""
            body = f"    return {check}{way.lower()}(it, references, count, values);\n" if kind == real else NOTHING
            yield f"int fmi{number}{way}{kind}", f"{REFERENCES}, {array}{size}", body
        if number == 3:
            sizes = f"{constant}size_t sizes[], const uint8_t *{constant}values[], size_t size"
            yield f"int fmi3{way}Binary", f"{REFERENCES}, {sizes}", NOTHING
            yield f"int fmi3{way}Clock", f"{REFERENCES}, {constant}bool values[]", NOTHING


FMI3: tuple[FUNCTIONS, ...] = (
    *_access(3),
    ("const char *fmi3GetVersion", "void", '    return "3.0";\n'),
    ("int fmi3SetDebugLogging", f"{ME}, bool on, size_t count, const char *const names[]", "    return OK;\n"),
    ("void *fmi3InstantiateModelExchange", f"{INSTANCE3}, {LOG3}", None),
    (
        "void *fmi3InstantiateCoSimulation",
        f"{INSTANCE3}, bool events, bool early, const unsigned int needed[], size_t count, {LOG3}, "
        "void (*update)(void)",
        "    return made(token, logging ? log : NULL, environment);\n",
    ),
    ("void *fmi3InstantiateScheduledExecution", f"{INSTANCE3}, {LOG3}, void (*update)(void *), {LOCKS}", None),
    ("void fmi3FreeInstance", ME, "    free(it);\n"),
    ("int fmi3EnterInitializationMode", f"{ME}, {SPAN.format('bool')}", f"{MY}{BEGIN}"),
    ("int fmi3ExitInitializationMode", ME, "    return OK;\n"),
    ("int fmi3EnterEventMode", ME, None),
    ("int fmi3Terminate", ME, "    return OK;\n"),
    ("int fmi3Reset", ME, f"{MY}{STEPPED}"),
    ("int fmi3GetNumberOfVariableDependencies", f"{ME}, unsigned int reference, size_t *size", None),
    (
        "int fmi3GetVariableDependencies",
        f"{ME}, unsigned int dependent, size_t elements[], unsigned int independents[], size_t others[], "
        "int kinds[], size_t size",
        None,
    ),
    ("int fmi3GetFMUState", *STATES["Get"]),
    ("int fmi3SetFMUState", *STATES["Set"]),
    ("int fmi3FreeFMUState", *STATES["Free"]),
    ("int fmi3SerializedFMUStateSize", *STATES["Size"]),
    ("int fmi3SerializeFMUState", *STATES["Pack"]),
    ("int fmi3DeserializeFMUState", *STATES["Unpack"]),
    ("int fmi3GetDirectionalDerivative", f"{ME}, {KNOWN}, {SEEDS3}", None),
    ("int fmi3GetAdjointDerivative", f"{ME}, {KNOWN}, {SEEDS3}", None),
    ("int fmi3EnterConfigurationMode", ME, None),
    ("int fmi3ExitConfigurationMode", ME, None),
    ("int fmi3GetIntervalDecimal", f"{REFERENCES}, double values[], int kinds[]", NOTHING),
    ("int fmi3GetIntervalFraction", f"{REFERENCES}, {FRACTIONS.format('')}, int kinds[]", NOTHING),
    ("int fmi3GetShiftDecimal", f"{REFERENCES}, double values[]", NOTHING),
    ("int fmi3GetShiftFraction", f"{REFERENCES}, {FRACTIONS.format('')}", NOTHING),
    ("int fmi3SetIntervalDecimal", f"{REFERENCES}, const double values[]", NOTHING),
    ("int fmi3SetIntervalFraction", f"{REFERENCES}, const {FRACTIONS.format('const ')}", NOTHING),
    ("int fmi3SetShiftDecimal", f"{REFERENCES}, const double values[]", NOTHING),
    ("int fmi3SetShiftFraction", f"{REFERENCES}, const {FRACTIONS.format('const ')}", NOTHING),
    ("int fmi3EvaluateDiscreteStates", ME, None),
    ("int fmi3UpdateDiscreteStates", f"{ME}, {ENDS3}", None),
    ("int fmi3EnterContinuousTimeMode", ME, None),
    ("int fmi3CompletedIntegratorStep", f"{ME}, bool final, bool *event, bool *end", None),
    ("int fmi3SetTime", f"{ME}, double time", None),
    ("int fmi3SetContinuousStates", f"{ME}, const double states[], size_t size", None),
    ("int fmi3GetContinuousStateDerivatives", f"{ME}, double values[], size_t size", None),
    ("int fmi3GetEventIndicators", f"{ME}, double values[], size_t size", None),
    ("int fmi3GetContinuousStates", f"{ME}, double values[], size_t size", None),
    ("int fmi3GetNominalsOfContinuousStates", f"{ME}, double values[], size_t size", None),
    ("int fmi3GetNumberOfEventIndicators", f"{ME}, size_t *size", EMPTY),
    ("int fmi3GetNumberOfContinuousStates", f"{ME}, size_t *size", EMPTY),
    ("int fmi3EnterStepMode", ME, None),
    ("int fmi3GetOutputDerivatives", f"{REFERENCES}, const int32_t orders[], double values[], size_t size", None),
    (
        "int fmi3DoStep",
        f"{ME}, double from, double length, bool final, bool *event, bool *end, bool *early, double *reached",
        TAKEN,
    ),
    ("int fmi3ActivateModelPartition", f"{ME}, unsigned int clock, double time", None),
)

FMI2: tuple[FUNCTIONS, ...] = (
    *_access(2),
    ("int fmi2GetStatus", f"{ME}, int kind, int *value", "    return DISCARD;\n"),
    ("int fmi2GetRealStatus", f"{ME}, int kind, double *value", REAL_STATUS),
    ("int fmi2GetIntegerStatus", f"{ME}, int kind, int *value", "    return DISCARD;\n"),
    ("int fmi2GetBooleanStatus", f"{ME}, int kind, int *value", "    return DISCARD;\n"),
    ("int fmi2GetStringStatus", f"{ME}, int kind, const char **value", "    return DISCARD;\n"),
    ("const char *fmi2GetTypesPlatform", "void", '    return "default";\n'),
    ("const char *fmi2GetVersion", "void", '    return "2.0";\n'),
    ("int fmi2SetDebugLogging", f"{ME}, int on, size_t count, const char *const names[]", "    return OK;\n"),
    (
        "void *fmi2Instantiate",
        "const char *name, int kind, const char *token, const char *resources, const Callbacks *calls, "
        "int visible, int logging",
        "    return kind == 1 && calls ? made(token, logging ? calls->log : NULL, calls->environment) : NULL;\n",
    ),
    ("void fmi2FreeInstance", ME, "    free(it);\n"),
    (
        "int fmi2SetupExperiment",
        f"{ME}, {SPAN.format('int')}",
        f"{MY}{BEGIN}",
    ),
    ("int fmi2EnterInitializationMode", ME, "    return OK;\n"),
    ("int fmi2ExitInitializationMode", ME, "    return OK;\n"),
    ("int fmi2Terminate", ME, "    return OK;\n"),
    ("int fmi2Reset", ME, f"{MY}{STEPPED}"),
    ("int fmi2GetFMUstate", *STATES["Get"]),
    ("int fmi2SetFMUstate", *STATES["Set"]),
    ("int fmi2FreeFMUstate", *STATES["Free"]),
    ("int fmi2SerializedFMUstateSize", *STATES["Size"]),
    ("int fmi2SerializeFMUstate", *STATES["Pack"]),
    ("int fmi2DeSerializeFMUstate", *STATES["Unpack"]),
    (
        "int fmi2GetDirectionalDerivative",
        f"{ME}, const unsigned int unknowns[], size_t unknown, const unsigned int knowns[], size_t known, "
        "const double seed[], double result[]",
        None,
    ),
    ("int fmi2EnterEventMode", ME, None),
    ("int fmi2NewDiscreteStates", f"{ME}, void *event", None),
    ("int fmi2EnterContinuousTimeMode", ME, None),
    ("int fmi2CompletedIntegratorStep", f"{ME}, int final, int *event, int *end", None),
    ("int fmi2SetTime", f"{ME}, double time", None),
    ("int fmi2SetContinuousStates", f"{ME}, const double states[], size_t size", None),
    ("int fmi2GetDerivatives", f"{ME}, double values[], size_t size", None),
    ("int fmi2GetEventIndicators", f"{ME}, double values[], size_t size", None),
    ("int fmi2GetContinuousStates", f"{ME}, double values[], size_t size", None),
    ("int fmi2GetNominalsOfContinuousStates", f"{ME}, double values[], size_t size", None),
    ("int fmi2SetRealInputDerivatives", f"{REFERENCES}, const int orders[], const double values[]", None),
    ("int fmi2GetRealOutputDerivatives", f"{REFERENCES}, const int orders[], double values[]", None),
    ("int fmi2DoStep", f"{ME}, double from, double length, int final", "    return advance(it, from, length);\n"),
    ("int fmi2CancelStep", ME, None),
)

STANDARDS = {"3.0": FMI3, "2.0": FMI2}
"""The functions of each version of the standard."""


def fmi_source(
    export: Export, version: str, token: str, values: Sequence[float], bounds: Sequence[tuple[float, float]]
) -> str:
    """The C source of an FMU beside that of its model.

    Args:
        export: the model, its name and its sample time.
        version: of the standard, a key of `STANDARDS`.
        token: that the importer must give.
        values: of the parameters and the constant variables.
        bounds: of the parameters.
    """
    name, upper = export.name, export.name.upper()
    logger, log = LOGGERS[version]
    words = {
        "MODEL": name,
        "INPUTS": f"{upper}_INPUTS",
        "OUTPUTS": f"{upper}_OUTPUTS",
        "CONSTANTS": f"{len(values)}u",
        "PARAMETERS": f"{len(bounds)}u",
        "LOW": _listed(low for low, _ in bounds),
        "HIGH": _listed(high for _, high in bounds),
        "SET": f"{name}_set(&it->now.model, it->now.p)" if bounds else "(void)it",
        "VALUES": _listed(values),
        "TOKEN": f'"{token}"',
        "STEP": repr(export.dt),
        "SLACK": repr(1e-6 * (export.dt or 1.0)),  # of times that are sums of steps
        "LOG": log.replace("MODEL_NAME", f'"{name}"'),
    }

    def put(found: re.Match[str]) -> str:
        return words[found[0]]

    core = re.sub(rf"\bMODEL(?=_)|\b(?:{'|'.join([*words][1:])})\b", put, CORE)
    prefix = f"FMI{version[0]}_FUNCTION_PREFIX"
    byte = "uint8_t" if version == "3.0" else "char"
    functions = "\n".join(_function(*each).replace("BYTE", byte) for each in STANDARDS[version])
    return (
        f"/* Made by emsid: the model as a co-simulation of FMI {version}. */\n#include <math.h>\n"
        "#include <stdbool.h>\n"
        f'#include <stddef.h>\n#include <stdint.h>\n#include <stdlib.h>\n#include <string.h>\n\n#include "{name}.h"\n\n'
        f"#ifdef {prefix}\n#define PREFIX {prefix}\n#else\n#define PREFIX\n#endif\n\n{logger}\n\n{core}\n{functions}"
    )


def _listed(values: Iterable[float]) -> str:
    """The elements of an array in C, which has at least one."""
    return ", ".join([*(repr(value).replace("inf", "HUGE_VAL") for value in values), "0.0"])


def _function(head: str, arguments: str, body: str | None) -> str:
    """The definition of a function; without a body it refuses."""
    kind, name = re.fullmatch(r"(.*?)(fmi\w+)", head).groups()  # type: ignore[union-attr]
    if body is None:
        refused = 'complain(it, "this is a co-simulation without events or derivatives")'
        body = f"    return {refused if kind == 'int ' else 'NULL'};\n"
    names = [
        re.findall(r"\(\*(\w+)\)|(\w+)(?:\[\])?$", each.strip())[0] for each in re.split(r",(?![^(]*\))", arguments)
    ]
    unused = [one or two for one, two in names if (one or two) != "void" and not re.search(rf"\b{one or two}\b", body)]
    ignored = "".join(f"    (void){each};\n" for each in unused)
    declared = f"EXPORT {kind}NAMED({name})({arguments})"
    start, rest = (MY, body.removeprefix(MY)) if body.startswith(MY) else ("", body)
    return f"{declared};\n{declared}\n{{\n{start}{ignored}{rest}}}\n"
