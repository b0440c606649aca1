"""What to write in MATLAB so that the numbers of an object can be read.

MATLAB saves objects of its classes in a format that is not documented. One line of MATLAB makes arrays or a table of
each that holds signals.
"""

from __future__ import annotations

_LINES = {
    "iddata": "u = {0}.u; y = {0}.y; Ts = {0}.Ts; save {0}_arrays.mat u y Ts -v7",
    "idfrd": "",
    "timetable": "writetimetable({0}, '{0}.csv')",
    "table": "writetable({0}, '{0}.csv')",
    "timeseries": "t = {0}.Time; y = {0}.Data; save {0}_arrays.mat t y -v7",
    "dataset": "writetable(dataset2table({0}), '{0}.csv')",
    "Simulink.SimulationOutput": "writetimetable(extractTimetable({0}), '{0}.csv')",
    "Simulink.SimulationData.Dataset": "writetimetable(extractTimetable({0}), '{0}.csv')",
    "Simulink.SimulationData.Signal": "writetimetable(extractTimetable({0}), '{0}.csv')",
    "datetime": "{0} = posixtime({0}); save {0}_arrays.mat {0} -v7",
    "duration": "{0} = seconds({0}); save {0}_arrays.mat {0} -v7",
}
"""By class: the line with the name of the variable in it; empty where the object has no signals."""
_MODELS = ("id", "ss", "tf", "zpk", "pid", "frd", "nlarx", "nlhw")
"""How the names of classes of models begin, which hold no signals."""


def reason_against_object(name: str, kind: str) -> str:
    """Why an object is no column, and the line of MATLAB that makes a file of its numbers.

    >>> reason_against_object("run", "timetable")
    "a MATLAB object of class timetable; write it in MATLAB by: writetimetable(run, 'run.csv')"
    >>> reason_against_object("model", "idnlarx")
    'a MATLAB object of class idnlarx, which holds a model and no signals'

    Args:
        name: of the variable, or of the field that holds it.
        kind: its class; empty where that is not known.
    """
    line = _LINES.get(kind)
    if line == "" or (line is None and kind.startswith(_MODELS)):
        return f"a MATLAB object of class {kind}, which holds a model and no signals"
    variable = name if name.isidentifier() else "x"
    line = line or "x = struct({0}); save {0}_arrays.mat x -v7"
    before = "" if variable == name else f"x = {name}; "
    return f"a MATLAB object of class {kind or 'unknown'}; write it in MATLAB by: {before}{line.format(variable)}"
